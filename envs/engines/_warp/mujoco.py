"""What the engines that call MuJoCo Warp have in common."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._rigid import Array
from .worlds import ConstraintSolver

ROWS = 2
"""Constraints to make room for in a world: one side of a limited joint at a time, and no fewer than
one, for without any MuJoCo Warp leaves the forces out of `Euler`, `implicitfast` and `implicit`."""


def mass_matrix(mujoco: Any, model: Any, data: Any) -> Array:
    """Of the first world, (dof, dof), from a MuJoCo model and MuJoCo Warp's data."""
    packed, full = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    packed.M[:] = data.M.numpy()[0]
    mujoco.mj_fullM(model, packed, full)
    return full


def constraint_solver(mjw: Any, model: Any, data: Any) -> ConstraintSolver:
    """Of MuJoCo Warp's model and data; from now on it reaches its cap without printing it."""
    option = model.opt
    option.warn_overflow &= ~mjw.OverflowType.ITERATIONS
    tolerance = float(option.tolerance.numpy()[0])
    return ConstraintSolver(data.solver_niter.numpy(), tolerance, int(option.iterations))
