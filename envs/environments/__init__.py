"""Gymnasium environments around an episode: single, vector, functional, rediscretized,
and any other whose discretization is stated.

Knows how an episode is offered to whoever learns or evaluates; the ids are the catalogue's.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from . import functional
    from .discretized_vector import DiscretizedVectorEnv
    from .environment import IntegEnv, make_setup
    from .foreign import SURVIVAL, ReturnGoal, return_of_success, time_limit
    from .functional import FunctionalEnv, Params
    from .rediscretized import RediscretizedEnv, rediscretize
    from .sequential_vector import SequentialVectorEnv
    from .stated import ASSUMED_RATE, Repeated, Rewards, StatedEnv, without_time_limit
    from .vector import IntegVectorEnv
else:
    __getattr__, __dir__ = lazy_door(__name__)
