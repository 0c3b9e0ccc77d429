"""Where a plant rests."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from integ_gym.envs import numerics
from integ_gym.envs.ops.array_ops import ARRAY
from integ_gym.envs.plants.interface import Plant, join_state

Array = npt.NDArray[np.float64]

_MOST_STEPS = 500
_FIRST = 0.5
"""Step times fastest slope at the start, and times a slope that leads away at all times."""
_LARGEST = 1e8
"""Step times fastest slope at which a coordinate that nothing pulls on still stays in place."""
_ROUNDING = 1e-12
"""Accelerations below this share of the fastest slope times the position are rounding."""
_STALLED = 8
"""Steps without a smaller acceleration after which there is nothing more to gain."""


def rest_state(plant: Plant) -> Array:
    r"""A stable equilibrium of the plant without control, state order, SI units, shape (n,).

    Follows :math:`\mathrm dq/\mathrm ds = a(q, 0)` by linearly implicit steps that grow as the
    acceleration falls, so that they begin as descent, end as Newton's method, and are of the
    plant's own scale however stiff or slow it is; along a slope that leads away from an equilibrium
    they stay small, so that none is taken for rest on the top of a hill.

    Raises:
        ValueError: if it does not come to rest.

    Source: Kelley and Keyes (1998), *Convergence analysis of pseudo-transient continuation*, SIAM
    Journal on Numerical Analysis 35.
    """
    n = len(plant.coordinates)
    q = best = 0.1 * np.arange(1.0, n + 1.0)
    least, first, step, stalled = np.inf, 0.0, 0.0, 0
    for _ in range(_MOST_STEPS):
        pull = _accelerations(plant, q[None])[0]
        slopes = numerics.jacobian(lambda points: _accelerations(plant, points), q)
        if not (np.isfinite(pull).all() and np.isfinite(slopes).all()):
            break
        size, rates = float(np.abs(pull).max()), np.linalg.eigvals(slopes)
        scale, away = float(np.abs(rates).max()) or 1.0, float(rates.real.max())
        first = first or size * _FIRST / scale
        stalled = 0 if size < least else stalled + 1
        if size < least:
            best, least = q, size
        small = least <= _ROUNDING * scale * (1.0 + np.abs(best).max())
        if small and (least == 0.0 or stalled >= _STALLED):
            return np.array(join_state(tuple(best), (0.0,) * n))
        step = min(first / size, _LARGEST / scale)
        if away > 0.0:
            step = min(step, _FIRST / away)
        q = q + np.linalg.solve(np.eye(n) / step - slopes, pull)
    raise ValueError(
        f"the plant {type(plant).__name__} does not come to rest without control; a diagnosis "
        "needs a plant with a stable equilibrium"
    )


def _accelerations(plant: Plant, points: Array) -> Array:
    """At zero speed and control, shape (lanes, n) to (lanes, n)."""
    q = tuple(points.T)
    nothing = tuple(np.zeros((len(q), len(points))))
    columns = plant.acceleration(ARRAY, q, nothing, nothing)
    return np.stack([np.broadcast_to(x, len(points)) for x in columns], -1)
