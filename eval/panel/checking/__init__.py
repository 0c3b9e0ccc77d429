"""A run held against its own plan: files, policies, records, and what is told of them.

Knows what is planned, what ran and what it came to; a room above running and results.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .page import against_plan, check_finished
    from .sample import check_records
else:
    __getattr__, __dir__ = lazy_door(__name__)
