"""integ-gym: Gymnasium environments in which the discretization is a constructor argument.

Importing this package registers ``IntegPendulum-v0``, ``IntegCartPole-v0``,
``IntegCartPoleSwingUp-v0`` and ``IntegElasticPendulum-v0``.
"""

from integ_gym.envs.registration import ENVIRONMENTS, register_environments

__all__ = ["ENVIRONMENTS"]

register_environments()
