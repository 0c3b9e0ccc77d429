"""Any Gymnasium MuJoCo task under another integrator and timestep."""

from .choice import mujoco_integrators
from .environment import RediscretizedEnv, rediscretize

__all__ = ["RediscretizedEnv", "mujoco_integrators", "rediscretize"]
