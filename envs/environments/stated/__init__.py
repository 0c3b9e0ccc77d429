"""Any Gymnasium environment, in a discretization that whoever made it states.

Knows what Gymnasium asks of an environment, and no more: state, energy and solver stay unknown.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .environment import StatedEnv
    from .repeated import Repeated, Rewards, without_time_limit
    from .setup import ASSUMED_RATE
else:
    __getattr__, __dir__ = lazy_door(__name__)
