"""What trainers have in common: configuration, runs side by side, evidence, errors."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .checks import LONGEST, MOST_LANES, check_rollout, fraction, whole
    from .config import TrainingConfig
    from .error import TrainingError, explained
    from .evidence import TrainingEvidence
    from .side_by_side import (
        OnTrained,
        Run,
        checked_runs,
        train_each,
        train_in_processes,
        training_bar,
        unheard,
        used,
    )
else:
    __getattr__, __dir__ = lazy_door(__name__)
