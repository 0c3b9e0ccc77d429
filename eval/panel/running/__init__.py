"""A panel run: training and evaluation in units of work, resumable, each made visible at once.

Knows the specification and the run's directory; results are reduced elsewhere.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .costs import ExpectedCost, fixed_cost, policy_costs, total_cost
    from .division import divide, memory_of, note_division, noted_division, waiting_chunks
    from .evaluation import (
        HANDMADE,
        TRYING,
        Evaluated,
        Subject,
        Successes,
        Tried,
        all_seconds,
        batches_of,
        evaluate_all,
        evaluate_batch,
        evaluated,
        expected_seconds,
        has_controller,
        knowing_home,
        not_evaluated,
        not_tried,
        search_of,
        statuses,
        tried,
        tried_in,
        try_and_note,
        unit_of,
        unit_of_cell,
    )
    from .panel import as_there, check_spec, complete, opened, subject_of
    from .reuse import bring, finished_policies
    from .run_directory import (
        CALLED,
        GIVEN,
        MANIFEST,
        PACKAGES,
        RunDirectory,
        RunDirectoryError,
        Seen,
        first_of,
        key_of,
        package_versions,
        read_manifest,
    )
    from .staging import DRIVEN, SHARED, UNITS, Desk, clear
    from .training import train_chunk_here
    from .units import (
        Unit,
        baseline_of,
        is_card_of,
        is_there,
        trained_units,
        training_config,
        units_of,
    )
    from .work import PanelError, Work, panel_bar, working_on
else:
    __getattr__, __dir__ = lazy_door(__name__)
