"""Tasks for engines that run them in other processes."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

from integ_gym.support.processes.workers import report_work

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
