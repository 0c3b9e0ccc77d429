"""Tasks given to worker processes, and the bar that shows what is done of them."""

from __future__ import annotations

import errno
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import BrokenExecutor, Executor
from contextlib import contextmanager
from typing import Any

from integ_gym.support.processes.workers import ESTIMATE_LOOK, Progress, work_bar
from integ_gym.support.sharing.clusters import Cluster


class PanelError(RuntimeError):
    """A unit of work that failed, in one sentence."""


class Work:
    """Tasks given to an executor, and the bar that shows what is done of them.

    Args:
        executor: runs them.
        progress: work that they have reported.
        bar: the bar.
    """

    def __init__(self, executor: Executor, progress: Progress, bar: Any) -> None:
        self._executor = executor
        self._progress = progress
        self._bar = bar
        self._phase = ""

    def skip(self, seconds: float) -> None:
        """Count work that was done before."""
        self._progress.begin_at(seconds)

    def do(
        self, phase: str, task: Callable[..., Any], arguments: Mapping[str, tuple[Any, ...]]
    ) -> list[Any]:
        """Run one task for each of ``arguments``, by name; what they return, in that order.

        Raises:
            PanelError: if one fails.
        """
        self._bar.set_postfix_str(phase, refresh=phase != self._phase)
        self._phase = phase
        futures = {self._executor.submit(task, *given): name for name, given in arguments.items()}
        for future in self._progress.ended(futures):
            error = future.exception()
            if isinstance(error, BrokenExecutor):
                raise PanelError(
                    f"a worker process was lost while {phase} {futures[future]}, perhaps for want "
                    "of memory; run the same command again to go on, with fewer --workers if it "
                    "happens again"
                ) from error
            if isinstance(error, Exception):
                named = f"{phase} {futures[future]} failed: {_told(error)}"
                raise PanelError(f"{named}; the rest is kept") from error
        return [future.result() for future in futures]


def _told(error: Exception) -> str:
    """What an error says, with its type where that helps; of a full disk the remedy."""
    if isinstance(error, OSError) and error.errno == errno.ENOSPC:
        return f"{error}: free some space, and run the same command again to go on"
    own = type(error).__module__.partition(".")[0] == "integ_gym"
    if own or isinstance(error, ValueError):
        return str(error)
    return f"{type(error).__name__}: {error}"


@contextmanager
def working(label: str, total: float, workers: int, shown: bool) -> Iterator[Work]:
    """What runs tasks in processes of this machine, and a bar.

    Args:
        label: of the bar.
        total: expected work, s.
        workers: processes; 0: tasks run in this one.
        shown: whether the bar is.
    """
    with panel_bar(label, total, shown) as bar:
        progress = Progress(bar)
        with progress.pool(workers) if workers else progress.here() as executor:
            yield Work(executor, progress, bar)


@contextmanager
def working_on(
    cluster: Cluster, bar: Any, prepare: Callable[[int], None] | None = None
) -> Iterator[Work]:
    """What runs tasks on an engine of others, and a bar.

    Args:
        cluster: the engine.
        bar: the bar; closed at the end.
        prepare: called once in each process.
    """
    with bar:
        progress = Progress(bar)
        with cluster.pool(progress, prepare) as executor:
            yield Work(executor, progress, bar)


def panel_bar(label: str, seconds: float, shown: bool) -> Any:
    """A bar over expected work, s."""
    return work_bar(label, seconds, shown, bar_format=ESTIMATE_LOOK)
