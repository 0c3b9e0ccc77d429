"""Evaluation of policies in cells: units of work, paired starts, replays, what can be achieved.

Knows finished policies, not how they were trained.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .achievability import (
        HANDMADE,
        TRYING,
        Tried,
        has_controller,
        not_tried,
        search_of,
        tried,
        tried_in,
        try_and_note,
        unit_of_cell,
    )
    from .replays import Successes
    from .subjects import Subject
    from .units import (
        Evaluated,
        all_seconds,
        batches_of,
        evaluate_all,
        evaluate_batch,
        evaluated,
        expected_seconds,
        knowing_home,
        not_evaluated,
        statuses,
        unit_of,
    )
else:
    __getattr__, __dir__ = lazy_door(__name__)
