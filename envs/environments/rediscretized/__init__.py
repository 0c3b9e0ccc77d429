"""Any Gymnasium MuJoCo task under another integrator and timestep.

Knows MuJoCo's models; what is not known of a stranger's task stays unknown.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .description import integrator_numbers
    from .environment import RediscretizedEnv, rediscretize
else:
    __getattr__, __dir__ = lazy_door(__name__)
