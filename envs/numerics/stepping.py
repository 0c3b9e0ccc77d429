"""A plant under an integrator and a constant control, step after step."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from ..arithmetic.array_ops import ARRAY
from ..arithmetic.ops import SCALAR, Component, Components
from ..engines.making import make_engine
from ..engines.native import NativeEngine
from ..mechanics.system import PlantSystem
from ..plants.interface import Plant, join_state, split_state

Array = npt.NDArray[np.float64]
State = Sequence[float] | Array
"""(q0, v0, q1, v1, …), SI units: the order of ``env.unwrapped.state``."""

OneStep = Callable[[Components, Components, float], tuple[Components, Components]]
"""(q, v, control) to (q, v) after one step."""


class Advance(Protocol):
    """Whatever steps a plant as :func:`advance` does, such as one that keeps records."""

    def __call__(
        self, integrator: str, plant: Plant, state: State, dt: float, steps: int, control: float
    ) -> Array: ...


def engine_of(integrator: str, system: PlantSystem, dt: Component) -> Any:
    """What advances a plant by an integrator, or by one of an engine's, ``"mujoco/Euler"``.

    Raises:
        ValueError: for an unknown engine or integrator.
    """
    engine, slash, own = integrator.partition("/")
    if not slash:
        engine, own = NativeEngine.name, integrator
    return make_engine(engine, system, own, dt)


def advance(
    integrator: str, plant: Plant, state: State, dt: float, steps: int = 1, control: float = 0.0
) -> Array:
    """State after some steps; NaN where the arithmetic fails.

    Args:
        integrator: a registered name, ``"module:Class"``, or ``"engine/integrator"``.
        plant: with numbers as parameters.
        state: shape (n,).
        dt: step, s.
        steps: how many.
        control: held throughout, in the plant's unit.

    Raises:
        ValueError: for an unknown integrator.
    """
    q, v = split_state(tuple(float(x) for x in state))
    engine = engine_of(integrator, PlantSystem(plant), dt)
    try:
        motion = engine.advance(SCALAR, q, v, ((control, steps),), None)
    except ArithmeticError:
        return np.full(len(state), np.nan)
    return np.array(join_state(motion.q, motion.v))


def one_step(integrator: str, plant: Plant, dt: float) -> OneStep:
    """One step of an integrator as a function; NaN where its solver does not converge.

    Args:
        integrator: a registered name, ``"module:Class"``, or ``"engine/integrator"``.
        plant: with numbers as parameters.
        dt: step, s.

    Raises:
        ValueError: for an unknown integrator.
    """
    engine = engine_of(integrator, PlantSystem(plant), dt)
    lost = (math.nan,) * len(plant.coordinates)

    def advanced(q: Components, v: Components, control: float) -> tuple[Components, Components]:
        motion = engine.advance(SCALAR, q, v, ((control, 1),), None)
        return (motion.q, motion.v) if motion.converged else (lost, lost)

    return advanced


def advance_lanes(
    integrator: str, plant: Plant, states: Array, dt: Component, control: Component = 0.0
) -> Array:
    """States after one step from many, shape (lanes, n) to (lanes, n).

    ``dt`` and ``control`` may be one for all or of shape (lanes,).
    """
    q, v = split_state(tuple(np.asarray(states, dtype=np.float64).T))
    engine = engine_of(integrator, PlantSystem(plant), dt)
    with np.errstate(all="ignore"):
        motion = engine.advance(ARRAY, q, v, ((control, 1),), None)
    return np.stack([np.broadcast_to(x, q[0].shape) for x in join_state(motion.q, motion.v)], -1)


WIDTH = 2e-3
"""Offset of the difference quotients: errors about 1e-12 in float64."""

SINGLE_WIDTH = 0.2
"""The same where images are float32: errors about 1e-6."""


def jacobian(mapping: Any, point: Array, width: float = WIDTH) -> Array:
    """∂mapping/∂point by central differences of order 6.

    Args:
        mapping: from points (lanes, n) to images (lanes, m).
        point: shape (n,).
        width: offset of the nearest points.

    Returns:
        Shape (m, n).
    """
    n = len(point)
    offsets = width * np.einsum("s,ij->sij", _OFFSETS, np.eye(n)).reshape(-1, n)
    images = mapping(point + offsets).reshape(len(_OFFSETS), n, -1)
    slopes: Array = np.einsum("s,sjm->mj", _WEIGHTS, images) / width
    return slopes


_OFFSETS = np.array([-3.0, -2.0, -1.0, 1.0, 2.0, 3.0])
_WEIGHTS = np.array([-1.0, 9.0, -45.0, 45.0, -9.0, 1.0]) / 60.0
