"""What a finished block leaves: outcomes by policy and cell, and what pins where they come from.

Knows the evidence that they are made of, and which of them may be combined.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .agreement import (
        Agreement,
        check_agree,
        compare,
        first_difference,
        note,
        noted_in,
        same_processor,
    )
    from .outcomes import Point, points
    from .summary import Origin, Summary, read_summary, summarize, write_summary
else:
    __getattr__, __dir__ = lazy_door(__name__)
