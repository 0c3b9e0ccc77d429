"""What engines on NVIDIA Warp share: worlds side by side, and MuJoCo Warp's model."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .mujoco import ROWS, constraint_solver, mass_matrix
    from .worlds import ConstraintSolver, WarpEngine, Worlds
else:
    __getattr__, __dir__ = lazy_door(__name__)
