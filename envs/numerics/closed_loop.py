"""How large a step a linear feedback survives."""

from __future__ import annotations

import math

import numpy as np

from ..plants import Plant
from .stepping import Array, advance_lanes, jacobian

_SCAN = 60
_TOLERANCE = 1e-9
"""Growth per step that counts as rounding."""


def critical_step(
    integrator: str, plant: Plant, gain: Array, smallest: float = 1e-3, largest: float = 1.0
) -> float:
    """Smallest step at which the loop of a plant and a fixed feedback is unstable upright.

    The control period is the step: u = −K x is taken at the start of each step and held.

    Args:
        integrator: a registered name or ``"module:Class"``.
        plant: with numbers as parameters.
        gain: K, shape (1, n), in the plant's state order and SI units.
        smallest: where the scan begins, s.
        largest: where it ends, s.

    Returns:
        The step, s; ``smallest`` where the loop is unstable there, ``inf`` where it is stable up
        to ``largest``.
    """
    grid = np.geomspace(smallest, largest, _SCAN)
    unstable = [h for h in grid if not _stable(integrator, plant, gain, h)]
    if not unstable:
        return math.inf
    high = float(unstable[0])
    low = float(grid[np.flatnonzero(grid == high)[0] - 1]) if high > smallest else high
    while high - low > 1e-6 * high:
        middle = 0.5 * (low + high)
        if _stable(integrator, plant, gain, middle):
            low = middle
        else:
            high = middle
    return high


def _stable(integrator: str, plant: Plant, gain: Array, dt: float) -> bool:
    def one_step(points: Array) -> Array:
        return advance_lanes(integrator, plant, points, dt, -(points @ gain[0]))

    upright = np.zeros(gain.shape[1])
    roots = np.linalg.eigvals(jacobian(one_step, upright))
    return bool(np.abs(roots).max() <= 1.0 + _TOLERANCE)
