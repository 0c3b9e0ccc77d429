"""Tasks for engines that run them in other processes."""

from __future__ import annotations

import multiprocessing
import os
import signal
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

from integ_gym.support.processes import report_work

_prepared: list[int] = []


def number_of_prepared(number: int) -> None:
    """What prepares a process, once."""
    _prepared.append(number)


def report_and_print(number: int) -> int:
    """Report work, print, and return the square."""
    assert _prepared in ([], [0])
    report_work(float(number))
    print(f"worked on {number}")
    return number**2


def fail() -> None:
    """A task that fails."""
    raise ZeroDivisionError("as it should")


def no_executor() -> int:
    """What is no executor."""
    return 3


def one_thread() -> ThreadPoolExecutor:
    """An executor of this process."""
    return ThreadPoolExecutor(1)


def two_processes() -> ProcessPoolExecutor:
    """An executor of fresh processes."""
    return ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn"))


def die_once(path: str) -> str:
    """Kill this process, but for the second time that a path is given."""
    if Path(path).exists():
        return "done"
    Path(path).touch()
    os.kill(os.getpid(), signal.SIGKILL)
    return "alive"


def touch(path: str) -> str:
    """Make a file, and return its name."""
    Path(path).touch()
    return path


def lose(path: str) -> None:
    """Count a try in a file, and report the worker lost."""
    with Path(path).open("a") as file:
        file.write(".")
    raise BrokenExecutor("gone")


def always_die() -> None:
    """Kill this process."""
    os.kill(os.getpid(), signal.SIGKILL)
