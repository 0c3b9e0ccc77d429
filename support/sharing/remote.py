"""Tasks of an engine of others: what they report and print comes back with what they return."""

from __future__ import annotations

import contextlib
import io
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any, NamedTuple

from ..processes.workers import Progress, limit_threads, reporting

MOST_TEXT = 10_000
"""Characters of what a task prints that come back, from its end."""


class Outcome(NamedTuple):
    """What a task comes back with.

    Attributes:
        result: what it returned.
        work: that it reported.
        text: that it printed.
    """

    result: Any
    work: float
    text: str


class RemoteExecutor(Executor):
    """Gives tasks to an engine of others as if its processes were of this machine.

    Args:
        engine: runs tasks in other processes.
        progress: is told of the work that tasks report, as each ends.
        prepare: called once in each process before its first task, with 0.
    """

    def __init__(
        self,
        engine: Executor,
        progress: Progress,
        prepare: Callable[[int], None] | None = None,
    ) -> None:
        self._engine = engine
        self._progress = progress
        self._prepare = prepare
        self._waiting: set[Future[Any]] = set()

    def submit(self, task: Callable[..., Any], /, *given: Any, **named: Any) -> Future[Any]:
        """Have a task run; what it prints is printed here, on standard error, when it ends."""
        outer: Future[Any] = Future()
        inner = self._engine.submit(remotely, self._prepare, task, given, named)
        self._waiting.add(inner)

        def pass_on(ended: Future[Any]) -> None:
            self._waiting.discard(ended)
            if ended.cancelled():
                outer.cancel()
                outer.set_running_or_notify_cancel()
            elif (error := ended.exception()) is not None:
                outer.set_exception(error)
            else:
                outer.set_result(self._taken(ended.result()))

        inner.add_done_callback(pass_on)
        return outer

    def cancel(self) -> None:
        """Give up what waits."""
        for inner in [*self._waiting]:
            inner.cancel()

    def _taken(self, outcome: Outcome) -> Any:
        result, work, text = outcome
        self._progress.add(work, show=False)
        if text:
            print(text, end="", file=sys.stderr, flush=True)
        return result


_turn = threading.Lock()
_prepared: set[str] = set()


def remotely(
    prepare: Callable[[int], None] | None,
    task: Callable[..., Any],
    given: tuple[Any, ...],
    named: dict[str, Any],
) -> Outcome:
    """Run a task in a process of an engine's: one at a time, with one thread for its numbers."""
    with _turn:
        limit_threads()
        if prepare is not None and repr(prepare) not in _prepared:
            prepare(0)
            _prepared.add(repr(prepare))
        printed = io.StringIO()
        with (
            reporting() as work,
            contextlib.redirect_stdout(printed),
            contextlib.redirect_stderr(printed),
        ):
            result = task(*given, **named)
        return Outcome(result, sum(work), printed.getvalue()[-MOST_TEXT:])
