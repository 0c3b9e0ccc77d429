"""From where a regulator brings a plant to rest upright: found by simulation."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from integ_gym.envs.engines.native import NativeEngine
from integ_gym.envs.mechanics import PlantSystem
from integ_gym.envs.ops.array_ops import ARRAY
from integ_gym.envs.plants.interface import Plant, join_state, split_state

_CATCH_TIME = 4.0
"""How long the regulator may take, in simulation, to bring a state near upright, s."""
_CATCH_ANGLE = 0.1
"""How near upright it must then be, rad."""
_STEP_RATE = 0.1
"""Largest integration step of that simulation times the rate of the plant."""


def caught(
    plant: Plant,
    regulate: Callable[[NDArray[Any]], NDArray[np.float64]],
    state: NDArray[np.float64],
    *,
    period: float,
    rate: float,
    limits: tuple[float, ...] = (),
) -> NDArray[np.bool_]:
    """Whether the regulated plant comes to rest upright from some states.

    Args:
        plant: whose last coordinate is the angle from upright, rad.
        regulate: controls in N or N m, shape (n,), of states.
        state: where the plant starts, in its state order and SI units, shape (2 coordinates, n).
        period: control period, s.
        rate: of the plant's pendulum, rad/s.
        limits: of the coordinates before the angle, which are not to be left, SI units.

    Returns:
        Shape (n,).
    """
    substeps = math.ceil(period * rate / _STEP_RATE)
    engine = NativeEngine(PlantSystem(plant), "rk4", period / substeps)
    kept = np.array([*limits, 0.5 * math.pi])[:, None]
    inside = np.ones(state.shape[1], dtype=bool)
    for _ in range(math.ceil(_CATCH_TIME / period)):
        q, v = split_state(tuple(state))
        motion = engine.advance(ARRAY, q, v, ((regulate(state), substeps),), None)
        state = np.array(join_state(motion.q, motion.v))
        inside &= (np.abs(np.array(motion.q)) <= kept).all(axis=0)
    near: NDArray[np.bool_] = inside & (np.abs(state[-2]) < _CATCH_ANGLE)
    return near
