"""Any Gymnasium MuJoCo task under another integrator and timestep."""

from integ_gym.envs.rediscretized.environment import RediscretizedEnv, rediscretize

__all__ = ["RediscretizedEnv", "rediscretize"]
