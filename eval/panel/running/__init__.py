"""A panel run: training and evaluation in units of work, resumable, each made visible at once.

Knows the specification and the run's directory; results are reduced elsewhere.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .achievability import Tried, tried
    from .evaluation import Subject
    from .evaluation_units import Evaluated, evaluate_all, evaluated, evaluation_seconds
    from .panel import complete, opened
    from .run_directory import (
        MANIFEST,
        RunDirectory,
        RunDirectoryError,
        package_versions,
        read_manifest,
    )
    from .units import baseline_of, is_card_of, trained_units, training_config, units_of
else:
    __getattr__, __dir__ = lazy_door(__name__)
