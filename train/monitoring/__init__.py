"""Overfitting to the discretization watched while it happens, in other people's training.

Measures a policy's return and success at home and elsewhere; verdicts are panels' business.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .gap import discretization_gap
    from .raw_model import RawModel
    from .sb3_callback import DiscretizationCallback
else:
    __getattr__, __dir__ = lazy_door(__name__)
