"""Units of a run given to workers, and the bar that shows what is done of them."""

from __future__ import annotations

import errno
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from integ_gym.support.errors import IntegGymError
from integ_gym.support.executors import Cluster, TaskPool
from integ_gym.support.files import read_files
from integ_gym.support.processes import ESTIMATE_LOOK, Progress, work_bar

from ..spec import PanelSpec
from .run_directory import RunDirectory


class PanelError(IntegGymError, RuntimeError):
    """A unit of work that failed, in one sentence."""


class Work:
    """Units of a run given to workers, each committed as it ends.

    Args:
        directory: of the run, held by this process.
        cluster: where.
        pool: runs tasks there.
        progress: work that they have reported.
        bar: shows it.
    """

    def __init__(
        self,
        directory: RunDirectory,
        cluster: Cluster,
        pool: TaskPool,
        progress: Progress,
        bar: Any,
    ) -> None:
        self._directory = directory
        self._cluster = cluster
        self._pool = pool
        self._progress = progress
        self._bar = bar
        self._phase = ""

    def skip(self, seconds: float) -> None:
        """Count work that was done before."""
        self._progress.begin_at(seconds)

    def commit(
        self, phase: str, task: Callable[..., None], units: Mapping[str, tuple[Any, ...]]
    ) -> None:
        """Do units, and have the files and the marker of each in place once it ends.

        Args:
            phase: what is done, in words.
            task: does a unit, and marks it as finished. Its first arguments are a specification
                and the directory that it writes to.
            units: by name, the specification and what follows the directory.

        Raises:
            PanelError: if one fails; what was finished stays.
        """
        directory = self._directory
        first: tuple[Callable[..., Any], ...] = (task,)
        if self._cluster.remote:
            directory, first = directory.copy_for_workers(), (_do_in_scratch, task)
        tasks = {unit: (*first, spec, directory, *given) for unit, (spec, *given) in units.items()}
        for _, files in self._results(phase, tasks, self._directory.discard_remains):
            if self._cluster.remote:
                self._directory.take(files)
            self._directory.storage.send()

    def do(
        self, phase: str, task: Callable[..., Any], arguments: Mapping[str, tuple[Any, ...]]
    ) -> list[Any]:
        """Run one task for each of ``arguments``, by name; what they return, in that order.

        Raises:
            PanelError: if one fails.
        """
        tasks = {name: (task, *given) for name, given in arguments.items()}
        found = dict(self._results(phase, tasks, lambda name: None))
        return [found[name] for name in tasks]

    def _results(
        self, phase: str, tasks: Mapping[str, tuple[Any, ...]], discard: Callable[[str], None]
    ) -> Iterator[tuple[str, Any]]:
        self._bar.set_postfix_str(phase, refresh=phase != self._phase)
        self._phase = phase
        try:
            for name, future in self._pool.run(tasks, discard):
                error = future.exception()
                if isinstance(error, Exception):
                    told = f"{phase} {name} failed: {_format_error(error)}"
                    raise PanelError(f"{told}; the rest is kept") from error
                yield name, future.result()
        except BrokenExecutor as error:
            raise PanelError(
                f"worker processes were lost again and again while {phase}, perhaps for want of "
                "memory; run the same command again to go on, with fewer --workers if it happens "
                "again"
            ) from error


def _do_in_scratch(
    task: Callable[..., None], spec: PanelSpec, directory: RunDirectory, *given: Any
) -> dict[str, bytes]:
    """Do a unit on a machine that does not see the run's directory; the files that it wrote."""
    with TemporaryDirectory(prefix="integ-gym-") as scratch:
        task(spec, directory.moved(Path(scratch)), *given)
        return read_files(Path(scratch))


def _format_error(error: Exception) -> str:
    """What an error says, with its type where that helps; of a full disk the remedy."""
    if isinstance(error, OSError) and error.errno == errno.ENOSPC:
        return f"{error}: free some space, and run the same command again to go on"
    own = type(error).__module__.partition(".")[0] == "integ_gym"
    if own or isinstance(error, ValueError):
        return str(error)
    return f"{type(error).__name__}: {error}"


@contextmanager
def open_work(
    directory: RunDirectory,
    cluster: Cluster,
    bar: Any,
    prepare: Callable[[int], None] | None = None,
) -> Iterator[Work]:
    """What does a run's units, for as long as the block lasts.

    Args:
        directory: of the run, held by this process.
        cluster: where.
        bar: the bar; closed at the end.
        prepare: called once in each process.
    """
    with bar:
        progress = Progress(bar)
        with TaskPool(cluster, progress, prepare) as pool:
            yield Work(directory, cluster, pool, progress, bar)


def panel_bar(label: str, seconds: float, shown: bool) -> Any:
    """A bar over expected work, s."""
    return work_bar(label, seconds, shown, bar_format=ESTIMATE_LOOK)
