"""One of any number of processes that finish a panel together, on nothing but a shared directory.

There is no driver: what is to be done in each phase is found out by whichever process is first, and
so is the page made. All else is taken unit by unit.
"""

from __future__ import annotations

import json
import os
import random
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from integ_gym.support import (
    LEASE,
    Claim,
    Claims,
    FolderFiles,
    Gone,
    check_sharing,
    held,
    limit_threads,
    pauses,
    read_object,
    work_bar,
    write_once,
)
from integ_gym.train import Workers, preparation

from ..results import write_artefact
from ..running import SHARED, Desk, PanelError, RunDirectory, check_spec, clear, memory_of
from ..specification import PanelSpec
from . import planning
from .shared_unit import SharedUnit, do_and_commit

RESULTS = "results"
_UNITS = "units"


@dataclass(frozen=True)
class Share:
    """What one of several processes is told.

    Attributes:
        workers: that the work is divided for, the same in all processes.
        gpus: whether each has a GPU.
        lease: time after which a unit whose process is silent is taken over, s.
        progress: show bars.
        command: how to run this again, for the page.
    """

    workers: int
    gpus: bool = False
    lease: float = LEASE
    progress: bool = True
    command: str = "integ_gym.run_panel"


def work_on(spec: PanelSpec, out: Path, share: Share) -> int:
    """Take part in a panel until all of it is done; how many units were done here.

    Args:
        spec: the panel, the same for all processes.
        out: its directory, the same for all processes.
        share: of this process.

    Raises:
        SpecError, RunDirectoryError: for what cannot be run.
        ValueError: if the directory's file system cannot be shared.
        PanelError: if a unit fails; others go on, and try it again after a lease.
    """
    fleet = Workers(share.workers, "gpu" if share.gpus else "cpu")
    limit_threads()
    if spec.fleet:
        preparation(fleet.device)(0)
    check_spec(spec, fleet, memory_of(spec, fleet))
    directory = RunDirectory(out, spec.to_json(), spec.engine_versions())
    if directory.is_finished():
        return 0
    with directory.joined():
        check_sharing(out)
        worker = _Worker(spec, directory, fleet, share)
        with suppress(Gone):  # whoever made the page cleared away what is no longer needed
            worker.work()
        return worker.done


class _Worker:
    """This process's part in a panel."""

    def __init__(
        self, spec: PanelSpec, directory: RunDirectory, fleet: Workers, share: Share
    ) -> None:
        self._spec = spec
        self._directory = directory
        self._fleet = fleet
        self._share = share
        self._desk = Desk(directory.path, SHARED)
        self._rng = random.Random()
        self.done = 0

    def work(self) -> None:
        """All phases, one after the other."""
        self._desk.open()
        spec, directory, fleet = self._spec, self._directory, self._fleet
        memory = memory_of(spec, fleet)
        phases: dict[str, Callable[[], Sequence[SharedUnit]]] = {
            "training": lambda: planning.training(spec, directory, fleet, memory),
            "trying what can be done": lambda: planning.trying(spec, directory),
            "evaluating": lambda: planning.evaluating(spec, directory, fleet.count),
        }
        for number, (phase, plan) in enumerate(phases.items()):
            self._phase(str(number), phase, plan)
        for claim in self._taken(RESULTS, [RESULTS]):
            write_artefact(spec, directory, self._share.command, fleet.count)
            claim.commit()
            claim.finish()
            clear(directory.path)

    def _phase(self, name: str, told: str, plan: Callable[[], Sequence[SharedUnit]]) -> None:
        """Find out what is to be done, and do it, with all others."""
        path = self._desk.root / f"{name}.json"
        for claim in self._taken(f"plan-{name}", [name]):
            if name == "0":
                self._directory.lift_seal()
            units = {_UNITS: [unit.plain() for unit in plan()]}
            with suppress(FileExistsError):  # of one that was taken for dead
                write_once(path, _json(units))
            claim.commit()
            claim.finish()
        held_by_name = {unit.name: unit for unit in _read(path)}
        with work_bar(f"{told}, here", len(held_by_name), self._share.progress) as bar:
            for claim in self._taken(name, [*held_by_name]):
                if self._do(claim, held_by_name[claim.unit]):
                    self.done += 1
                    bar.update(1)

    def _do(self, claim: Claim, unit: SharedUnit) -> bool:
        """Do a unit; False if another worker took it over.

        Raises:
            PanelError: if it fails.
            Gone: if all is over, which a worker that slept may find by what it misses.
        """
        try:
            return do_and_commit(self._desk, claim, unit)
        except Gone:
            raise
        except Exception as error:
            if not self._desk.root.exists():
                raise Gone(str(self._desk.root)) from None
            raise PanelError(
                f"{unit.name} failed: {error}; another worker tries it again in "
                f"{self._share.lease:g} s, and the rest is kept"
            ) from error

    def _taken(self, folder: str, units: Sequence[str]) -> Iterator[Claim]:
        """Units one after the other, each held while it is worked on, until all are done.

        Raises:
            Gone: if all is over.
        """
        with self._files(folder) as files:
            claims = Claims(files, units, self._share.lease, owner=str(os.getpid()))
            waits = pauses(self._share.lease, self._rng)
            while not claims.done:
                claim = claims.take()
                if claim is not None:
                    with held(claim, self._share.lease):
                        yield claim
                    waits = pauses(self._share.lease, self._rng)
                elif not claims.done:
                    time.sleep(next(waits))

    @contextmanager
    def _files(self, folder: str) -> Iterator[FolderFiles]:
        """Claims of a phase.

        Raises:
            Gone: if the desk is not there any more.
        """
        root = self._desk.claims / folder
        try:
            root.mkdir(exist_ok=True)
        except FileNotFoundError:
            raise Gone(str(root)) from None
        files = FolderFiles(root)
        try:
            yield files
        finally:
            files.close()


def _json(content: Mapping[str, Any]) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        path.write_text(json.dumps(content), encoding="utf-8")

    return write


def _read(path: Path) -> list[SharedUnit]:
    """What is to be done in a phase.

    Raises:
        Gone: if all is over.
    """
    if not path.exists():
        raise Gone(str(path))
    told = read_object(path, {_UNITS: list}, "remove it")
    return [SharedUnit.of(one) for one in told[_UNITS]]
