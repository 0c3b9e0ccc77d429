"""Forward, then back: what a reversible map undoes."""

from __future__ import annotations

import numpy as np

from ..plants import Plant
from .stepping import Advance, Array, State, advance


def reversibility_errors(
    integrator: str,
    plant: Plant,
    state: State,
    dt: float,
    duration_s: float = 10.0,
    control: float = 0.0,
    follow: Advance = advance,
) -> Array:
    """|state − start| after going forward, turning all velocities round, and coming back.

    Rounding for a reversible integrator on a plant without damping.

    Args:
        integrator: a registered name or ``"module:Class"``.
        plant: with numbers as parameters.
        state: start, shape (n,), in state order.
        dt: step, s.
        duration_s: length of the way out.
        control: held throughout, in the plant's unit.
        follow: what takes the steps.

    Returns:
        Shape (n,), in state order and SI units; NaN where the arithmetic fails.

    Source: Hairer, Lubich and Wanner, *Geometric Numerical Integration*, 2nd ed., V.1.
    """
    start = np.asarray(state, dtype=np.float64)
    turn = np.tile([1.0, -1.0], len(start) // 2)
    steps = round(duration_s / dt)
    away = follow(integrator, plant, start, dt, steps, control)
    if not np.isfinite(away).all():
        return away
    back: Array = turn * follow(integrator, plant, turn * away, dt, steps, control)
    return np.abs(back - start)


def reversibility_defect(
    integrator: str,
    plant: Plant,
    state: State,
    dt: float,
    duration_s: float = 10.0,
    control: float = 0.0,
) -> float:
    """The largest of :func:`reversibility_errors`."""
    return float(reversibility_errors(integrator, plant, state, dt, duration_s, control).max())
