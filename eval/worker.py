"""Worker processes: started afresh, one thread each, ended with their parent."""

from __future__ import annotations

import multiprocessing
import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import Any

_report: Callable[[float], None] | None = None


class Progress:
    """Work done, added up over worker processes.

    Workers call :func:`report_work`; the parent reads :meth:`total`.
    """

    def __init__(self) -> None:
        self._context = multiprocessing.get_context("spawn")
        self._done = self._context.Value("d", 0.0)

    def total(self) -> float:
        """Work reported so far."""
        return float(self._done.value)

    def pool(self, workers: int) -> ProcessPoolExecutor:
        """A pool of fresh processes that report here."""
        return ProcessPoolExecutor(
            max_workers=workers,
            mp_context=self._context,
            initializer=_start_worker,
            initargs=(os.getpid(), self._done),
        )


def report_work(amount: float) -> None:
    """Add to the work done; without a pool it goes nowhere."""
    if _report is not None:
        _report(amount)


def _start_worker(parent: int, done: Any) -> None:
    global _report

    def add(amount: float) -> None:
        with done.get_lock():
            done.value += amount

    _report = add
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    _limit_threads()


def _end_with(parent: int) -> None:
    """End this process when its parent is gone."""
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


def _limit_threads() -> None:
    """One thread for the numerical libraries of this worker process."""
    from threadpoolctl import threadpool_limits

    threadpool_limits(limits=1)
