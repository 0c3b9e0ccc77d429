"""Any Gymnasium MuJoCo task under another integrator and timestep."""

from integ_gym.envs.rediscretized.environment import (
    RediscretizedEnv,
    mujoco_integrators,
    rediscretize,
)

__all__ = ["RediscretizedEnv", "mujoco_integrators", "rediscretize"]
