"""integ-gym: Gymnasium environments in which the discretization is a constructor argument.

Importing this package registers ``IntegPendulum-v0``, ``IntegCartPole-v0``,
``IntegCartPoleSwingUp-v0`` and ``IntegElasticPendulum-v0``. :func:`rediscretize` gives
Gymnasium's MuJoCo tasks the same choice.
"""

from integ_gym.envs import rediscretize
from integ_gym.envs import ENVIRONMENTS, register_environments

__all__ = ["ENVIRONMENTS", "rediscretize"]

register_environments()
