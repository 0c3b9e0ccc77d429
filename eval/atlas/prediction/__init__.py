"""The law that is fitted to an atlas, and what it lets expect of a policy that nobody has trained.

Knows points of an atlas and their numbers; never how they were run.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .fitting import (
        LEVEL,
        QUIET,
        Curve,
        Line,
        Trial,
        errors_of,
        fit,
        off_by_chance,
        telling,
        trials,
    )
    from .predicting import LAW, Law, Prediction, doubt, law, predict
else:
    __getattr__, __dir__ = lazy_door(__name__)
