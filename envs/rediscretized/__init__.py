"""Any Gymnasium MuJoCo task under another integrator and timestep."""

from integ_gym.envs.rediscretized.choice import mujoco_integrators
from integ_gym.envs.rediscretized.environment import RediscretizedEnv, rediscretize

__all__ = ["RediscretizedEnv", "mujoco_integrators", "rediscretize"]
