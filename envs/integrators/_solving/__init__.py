"""What integrators solve on the way: Newton's method, linear systems, kinks, an embedded pair.

Knows equations over components, not which integrator asks.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .dop853 import trial_step
    from .kink import time_of_kink
    from .linear import solve_linear
    from .newton import Solved, differences, solve, solve_velocity
else:
    __getattr__, __dir__ = lazy_door(__name__)
