"""One of any number of processes that finish a panel together, on nothing but a shared directory.

There is no driver: what is to be done in each phase is found out by whichever process is first, and
so is the page made. All else is taken unit by unit.
"""

from __future__ import annotations

import os
import random
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from integ_gym.support.processes.workers import limit_threads, work_bar
from integ_gym.support.sharing.claims import (
    BLOCK,
    LEASE,
    Claim,
    Claims,
)
from integ_gym.support.sharing.folder_files import Gone
from integ_gym.support.sharing.holding import held, pauses
from integ_gym.support.storing.storage import Storage
from integ_gym.train.fleet.worker import Workers

from ..results.ending import phases
from ..results.outputs import write_artefact
from ..running.division import memory_of, note_division
from ..running.evaluation.achievability import TRYING
from ..running.panel import check_spec
from ..running.reuse import bring, finished_policies
from ..running.run_directory import RunDirectory
from ..running.staging import UNITS
from ..running.work import PanelError
from ..specification.panel_spec import PanelSpec
from . import planning
from .driving import PAGES, commit_pages, in_time
from .shared_unit import SharedUnit, do_and_commit


@dataclass(frozen=True)
class Share:
    """What one of several processes is told.

    Attributes:
        workers: that the work is divided for, the same in all processes.
        gpus: whether each has a GPU.
        lease: time after which a unit whose process is silent is taken over, s.
        progress: show bars.
        command: how to run this again, for the page.
        policies: directory of a finished panel whose policies are taken instead of training.
    """

    workers: int
    gpus: bool = False
    lease: float = LEASE
    progress: bool = True
    command: str = "integ_gym.run_panel"
    policies: Path | None = None


def work_on(spec: PanelSpec, out: Storage, share: Share) -> int:
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
        from integ_gym.train.fleet.training import preparation

        preparation(fleet.device)(0)
    check_spec(spec, fleet, memory_of(spec, fleet))
    directory = RunDirectory(out, spec.to_json(), spec.engine_versions())
    if directory.is_finished():
        return 0
    source = None if share.policies is None else finished_policies(share.policies, spec)
    with directory.joined(share.lease):
        if not out.remote:
            out.check()
        worker = _Worker(spec, directory, fleet, share, source)
        with suppress(Gone):  # whoever made the page cleared away what is no longer needed
            worker.work()
        if not out.remote and not directory.desk.claims.exists():
            directory.finish_work()  # of what one that slept wrote after that
        if out.remote and not directory.desk.was_finished:
            with in_time(directory):
                raise Gone(str(out))
        return worker.done


class _Worker:
    """This process's part in a panel."""

    def __init__(
        self,
        spec: PanelSpec,
        directory: RunDirectory,
        fleet: Workers,
        share: Share,
        source: RunDirectory | None,
    ) -> None:
        self._spec = spec
        self._directory = directory
        self._fleet = fleet
        self._share = share
        self._source = source
        self._desk = directory.desk
        self._rng = random.Random()
        self.done = 0

    def work(self) -> None:
        """All phases, one after the other."""
        self._desk.open()
        spec, directory, fleet = self._spec, self._directory, self._fleet
        memory = memory_of(spec, fleet)
        plans: dict[str, Callable[[], tuple[Sequence[SharedUnit], dict[str, Any] | None]]] = {
            "training": lambda: planning.training_and_division(spec, directory, fleet, memory),
            TRYING: lambda: (planning.trying(spec, directory), None),
        }
        for part in spec.parts():
            told = f"evaluating from {part.latest.start}" if part.latest.start else "evaluating"
            plans[told] = partial(self._evaluating, part)
        for number, (phase, plan) in enumerate(plans.items()):
            self._phase(str(number), phase, plan)
        last = str(len(plans))
        self._desk.plan(last, [{"name": PAGES}])
        self._desk.planned(last)
        for claim in self._taken(last, [PAGES]):
            self._write_pages(claim)

    def _evaluating(self, part: PanelSpec) -> tuple[Sequence[SharedUnit], None]:
        return planning.evaluating(part, self._directory, self._fleet.count), None

    def _write_pages(self, claim: Claim) -> None:
        """Write all that is made of the records; who is overtaken leaves it as another made it."""
        spec, directory = self._spec, self._directory
        if not claim.decided:
            directory.storage.fetch()
            command, count = self._share.command, self._fleet.count
            with phases(f"panel {spec.name}", self._share.progress) as begin:
                write_artefact(spec, directory, command, count, begin=begin)
        if commit_pages(directory, claim):
            directory.finish_work()

    def _phase(
        self,
        name: str,
        told: str,
        plan: Callable[[], tuple[Sequence[SharedUnit], dict[str, Any] | None]],
    ) -> None:
        """Find out what is to be done, and do it, with all others."""
        for claim in self._taken(f"plan-{name}", [name]):
            try:
                self._find_out(name, plan, claim)
            except Gone:  # another found it out, if not all is over
                self._desk.check()
        planned = self._desk.planned(name)
        if planned is None:
            raise Gone(name)
        held_by_name = {unit.name: unit for unit in map(SharedUnit.of, planned[UNITS])}
        shown = self._share.progress and bool(held_by_name)
        with work_bar(f"{told}, here", len(held_by_name), shown) as bar:
            for claim in self._taken(name, [*held_by_name]):
                if self._do(claim, held_by_name[claim.unit]):
                    self.done += 1
                    bar.update(1)

    def _find_out(
        self,
        name: str,
        plan: Callable[[], tuple[Sequence[SharedUnit], dict[str, Any] | None]],
        claim: Claim,
    ) -> None:
        """Find out what is to be done; what was found first counts.

        Raises:
            Gone: if another was faster, and this one was about to remove something.
        """
        directory = self._directory
        directory.is_ours = claim.renew
        if name == "0":
            directory.end_others()
            directory.lift_seal(self._desk.root)
        directory.storage.fetch()
        if name == "0" and self._source is not None:
            bring(self._source, directory, self._spec)
        units, division = plan()
        if self._desk.plan(name, [unit.plain() for unit in units], BLOCK, division):
            note_division(directory, division)
            directory.storage.drop_missing()
        claim.commit()
        claim.finish()

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
            self._desk.check()
            raise PanelError(
                f"{unit.name} failed: {error}; another worker tries it again in "
                f"{self._share.lease:g} s, and the rest is kept"
            ) from error

    def _taken(self, folder: str, units: Sequence[str]) -> Iterator[Claim]:
        """Units one after the other, each held while it is worked on, until all are done.

        Raises:
            Gone: if all is over.
        """
        with closing(self._desk.claims_of(folder)) as files:
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
