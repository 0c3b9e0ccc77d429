"""Controllers that nobody trained, for the same seat as a trained policy.

Random, zero and hand-made ones, made by name for whichever task names them.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .making import BASELINES, has_handmade, make_baseline, possible_baselines
else:
    __getattr__, __dir__ = lazy_door(__name__)
