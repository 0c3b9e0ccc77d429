"""Worker processes: started afresh, one thread each, ended with their parent."""

from __future__ import annotations

import multiprocessing
import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
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

    def pool(
        self, workers: int, prepare: Callable[[int], None] | None = None
    ) -> ProcessPoolExecutor:
        """A pool of fresh processes that report here.

        Args:
            workers: how many.
            prepare: called once in each process, with its number from 0; importable from a module.
        """
        return ProcessPoolExecutor(
            max_workers=workers,
            mp_context=self._context,
            initializer=_start_worker,
            initargs=(os.getpid(), self._done, self._context.Value("i", 0), prepare),
        )


def report_work(amount: float) -> None:
    """Add to the work done; without a pool it goes nowhere."""
    if _report is not None:
        _report(amount)


def peak_memory() -> int | None:
    """Most memory that this process has held, bytes; None where the system does not tell.

    What `getrusage` tells counts the process that this one was started from.
    """
    status = Path("/proc/self/status")
    if not status.exists():
        return None
    lines = status.read_text(encoding="ascii").splitlines()
    (kib,) = (line.split()[1] for line in lines if line.startswith("VmHWM"))
    return 1024 * int(kib)


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _start_worker(
    parent: int, done: Any, started: Any, prepare: Callable[[int], None] | None
) -> None:
    global _report

    def add(amount: float) -> None:
        with done.get_lock():
            done.value += amount

    _report = add
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    _limit_threads()
    if prepare is not None:
        with started.get_lock():
            number = started.value
            started.value += 1
        prepare(number)


def _end_with(parent: int) -> None:
    """End this process when its parent is gone."""
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


def _limit_threads() -> None:
    """One thread for the numerical libraries of this worker process."""
    from threadpoolctl import threadpool_limits

    threadpool_limits(limits=1)
