"""Tasks given to worker processes, and the bar that shows what is done of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

from integ_gym.support import Progress, work_bar


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

    def skip(self, seconds: float) -> None:
        """Count work that was done before."""
        self._progress.add(seconds)

    def do(
        self, phase: str, task: Callable[..., Any], arguments: Mapping[str, tuple[Any, ...]]
    ) -> list[Any]:
        """Run one task for each of ``arguments``, by name; what they return, in that order.

        Raises:
            PanelError: if one fails.
        """
        self._bar.set_postfix_str(phase, refresh=False)
        futures = {self._executor.submit(task, *given): name for name, given in arguments.items()}
        for future in self._progress.ended(futures):
            error = future.exception()
            if isinstance(error, Exception):
                named = f"{phase} {futures[future]} failed: {error}"
                raise PanelError(f"{named}; the rest is kept") from error
        return [future.result() for future in futures]


@contextmanager
def working(label: str, total: float, workers: int, shown: bool) -> Iterator[Work]:
    """What runs tasks, and a bar.

    Args:
        label: of the bar.
        total: expected work, s.
        workers: processes; 0: tasks run in this one.
        shown: whether the bar is.
    """
    look = "{l_bar}{bar}| elapsed {elapsed}, about {remaining} left{postfix}"  # ", phase"
    with work_bar(label, total, shown, bar_format=look) as bar:
        progress = Progress(bar)
        with progress.pool(workers) if workers else progress.here() as executor:
            yield Work(executor, progress, bar)
