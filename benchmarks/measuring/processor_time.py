"""Processor time of this process and of those that it has started, as some engines have their own.

Linux alone: every process has a clock there that others can read.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import psutil


def processor_clocks() -> list[int]:
    """Clocks of this process and of all below it that are alive."""
    below = psutil.Process().children(recursive=True)
    return [time.CLOCK_PROCESS_CPUTIME_ID, *[_clock_of(process.pid) for process in below]]


def read_clocks(clocks: Sequence[int]) -> float:
    """Their sum, s."""
    return sum(map(time.clock_gettime, clocks))


def _clock_of(pid: int) -> int:
    """What `clock_getcpuclockid` gives for a process (Linux, `posix-timers_types.h`)."""
    return ~pid << 3 | 2
