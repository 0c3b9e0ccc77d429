"""Processes and the machine that they run on: workers, what can be sent to them, locks, cores.

Knows functions that are called elsewhere, and nothing of what they do.
"""

from typing import TYPE_CHECKING

from ..doors import lazy_door

if TYPE_CHECKING:
    from .locks import FileLock
    from .machine import host, instruction_sets
    from .spawning import SpawnError, check_spawning
    from .threads import ahead
    from .workers import (
        ESTIMATE_LOOK,
        Progress,
        cores,
        limit_threads,
        report_work,
        reporting,
        work_bar,
    )
else:
    __getattr__, __dir__ = lazy_door(__name__)
