"""A panel on an engine of others, or by any number of processes on one directory or object store.

What is done is what a run on one machine does, unit by unit: each is named by a small value, done
beside the run, and put in place once it is decided that it counts.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .driving import complete_on, evaluate_on, processes, rewriting, write_pages
    from .working import Share, work_on
else:
    __getattr__, __dir__ = lazy_door(__name__)
