"""Tasks given to worker processes, and the bar that shows what is done of them."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, wait
from contextlib import contextmanager
from typing import Any

from tqdm import tqdm

from integ_gym.support import Progress


class PanelError(RuntimeError):
    """A unit of work that failed, in one sentence."""


class Work:
    """Tasks given to an executor, and the bar that shows what is done of them.

    Args:
        executor: runs them.
        done: work that they have reported.
        bar: the bar.
    """

    def __init__(self, executor: Executor, done: Callable[[], float], bar: Any) -> None:
        self._executor = executor
        self._done = done
        self._bar = bar
        self._skipped = 0.0

    def skip(self, seconds: float) -> None:
        """Count work that was done before."""
        self._skipped += seconds
        self._show()

    def do(
        self, phase: str, task: Callable[..., Any], arguments: Mapping[str, tuple[Any, ...]]
    ) -> list[Any]:
        """Run one task for each of ``arguments``, by name; what they return, in that order.

        Raises:
            PanelError: if one fails.
        """
        self._bar.set_postfix_str(phase, refresh=False)
        futures = {self._executor.submit(task, *given): name for name, given in arguments.items()}
        running = set(futures)
        while running:
            ended, running = wait(running, timeout=0.5, return_when=FIRST_COMPLETED)
            for future in ended:
                error = future.exception()
                if isinstance(error, Exception):
                    named = f"{phase} {futures[future]} failed: {error}"
                    raise PanelError(f"{named}; the rest is kept") from error
            self._show()
        return [future.result() for future in futures]

    def _show(self) -> None:
        done = self._done() + self._skipped
        self._bar.update(min(self._bar.total, done) - self._bar.n)


@contextmanager
def working(label: str, total: float, workers: int, shown: bool) -> Iterator[Work]:
    """What runs tasks, and a bar.

    Args:
        label: of the bar.
        total: expected work, s.
        workers: processes; 0: tasks run in this one.
        shown: whether the bar is.
    """
    with tqdm(
        total=total,
        desc=label,
        disable=not shown,
        mininterval=0.5 if sys.stderr.isatty() else 15.0,
        smoothing=0.05,
        bar_format="{l_bar}{bar}| elapsed {elapsed}, about {remaining} left{postfix}",  # ", phase"
    ) as bar:
        shared = Progress()
        with shared.pool(workers) if workers else shared.here() as executor:
            yield Work(executor, shared.total, bar)
