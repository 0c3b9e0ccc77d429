"""A plant under an integrator and a constant control, step after step."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from ..engines.stepping import NativeEngine, make_engine
from ..ops.ops import ARRAY, SCALAR, Component, Components, join_state, split_state
from ..plants.interface import Plant, controls_of
from ..plants.oscillator import Oscillator
from ..plants.system import PlantSystem

Array = npt.NDArray[np.float64]
State = Sequence[float] | Array
"""(q0, v0, q1, v1, …), SI units."""

OneStep = Callable[[Components, Components, Any], tuple[Components, Components]]
"""(q, v, control) to (q, v) after one step."""


class Advance(Protocol):
    """Whatever steps a plant as :func:`advance` does, such as one that keeps records."""

    def __call__(
        self, integrator: str, plant: Plant, state: State, dt: float, steps: int, control: float
    ) -> Array: ...


def engine_of(integrator: str, system: PlantSystem, dt: Component) -> Any:
    """What advances a plant by an integrator, or by one of an engine's, ``"mujoco/Euler"``.

    Settings of the engine's solver follow it as JSON, ``'mujoco/Euler {"iterations": 1}'``.

    Raises:
        ValueError: for an unknown engine or integrator.
    """
    engine, slash, own = integrator.partition("/")
    if not slash:
        engine, own = NativeEngine.name, integrator
    own, _, solver = own.partition(" ")
    return make_engine(engine, system, own, dt, json.loads(solver) if solver else None)


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
        motion = engine.advance(SCALAR, q, v, ((controls_of(plant, control), steps),), None)
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

    def advance_once(q: Components, v: Components, control: Any) -> tuple[Components, Components]:
        motion = engine.advance(SCALAR, q, v, ((controls_of(plant, control), 1),), None)
        return (motion.q, motion.v) if motion.converged else (lost, lost)

    return advance_once


def advance_lanes(
    integrator: str, plant: Plant, states: Array, dt: Component, control: Component = 0.0
) -> Array:
    """States after one step from many, shape (lanes, n) to (lanes, n).

    ``dt`` and ``control`` may be one for all or of shape (lanes,).
    """
    q, v = split_state(tuple(np.asarray(states, dtype=np.float64).T))
    engine = engine_of(integrator, PlantSystem(plant), dt)
    with np.errstate(all="ignore"):
        motion = engine.advance(ARRAY, q, v, ((controls_of(plant, control), 1),), None)
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


def probe_state(plant: Plant) -> Array:
    """A state away from rest and symmetries, SI units, shape (n,): its own where it has one."""
    if hasattr(plant, "probe"):
        return np.array(plant.probe)
    n = len(plant.coordinates)
    q = [0.7 + 0.4 * i for i in range(n)]
    v = [0.5 - 0.3 * i for i in range(n)]
    return np.array(join_state(tuple(q), tuple(v)))


def fastest_rate(plant: Plant, state: State | None = None) -> float:
    """The largest of :func:`linear_rates`, rad/s."""
    return float(linear_rates(plant, state)[-1])


def linear_rates(plant: Plant, state: State | None = None) -> Array:
    """|eigenvalues| of the plant's linearization at a state, without control, rad/s, ascending.

    Args:
        plant: with numbers as parameters.
        state: shape (n,); None: :func:`probe_state`.
    """
    return np.sort(np.abs(np.linalg.eigvals(_linearize(plant, state))))


def fastest_mode(plant: Plant, state: State) -> Array:
    """Shape of the fastest small motion about a rest state, without control.

    Args:
        plant: with numbers as parameters.
        state: shape (n,), in state order.

    Returns:
        Displacements of the coordinates, the largest 1, shape (n / 2,).
    """
    linear = _linearize(plant, state)
    rates = np.linalg.eigvals(linear)
    fastest = rates[np.argmax(np.abs(rates))]
    # The null vector by singular values: eigenvectors are poor beside a cart that rolls freely.
    shape = np.linalg.svd(linear - fastest * np.eye(len(linear)))[2][-1].conj()[0::2]
    largest = np.argmax(np.abs(shape))
    turned: Array = (shape * shape[largest].conj()).real
    mode: Array = turned / turned[largest]
    return mode


def _linearize(plant: Plant, state: State | None) -> Array:
    """∂(v, a)/∂(q, v) in state order, shape (n, n)."""
    system = PlantSystem(plant)

    def rates(points: Array) -> Array:
        q, v = split_state(tuple(points.T))
        acceleration, _ = system.rates(ARRAY, q, v, controls_of(plant, 0.0))
        columns = join_state(v, acceleration)
        return np.stack([np.broadcast_to(x, v[0].shape) for x in columns], -1)

    point = probe_state(plant) if state is None else np.asarray(state, dtype=np.float64)
    return jacobian(rates, point)


LARGEST = 100.0
"""hω up to which stability is examined; a method stable so far counts as stable at any step."""

_TOLERANCE = 1e-10
"""Growth per step that counts as rounding."""

_LOOP_TOLERANCE = 1e-9
"""The same of a closed loop, whose step is measured by differences."""


@dataclass(frozen=True)
class LinearMap:
    """One step on ẍ = −ω²x in the coordinates (ωx, ẋ).

    Attributes:
        h_omega: step times natural frequency, dimensionless.
        matrix: the step, 2×2.
    """

    h_omega: float
    matrix: tuple[tuple[float, float], tuple[float, float]]

    @property
    def determinant(self) -> float:
        """Factor on areas of phase space."""
        (a, b), (c, d) = self.matrix
        return a * d - b * c

    @property
    def spectral_radius(self) -> float:
        """Factor per step on the amplitude in the long run; NaN where the step fails."""
        if not np.isfinite(self.matrix).all():
            return math.nan
        return float(np.abs(np.linalg.eigvals(self.matrix)).max())

    @property
    def energy_multipliers(self) -> tuple[float, float]:
        """Smallest and largest factor on the energy in one step, over all phases."""
        values = np.linalg.svd(self.matrix, compute_uv=False) ** 2
        return float(values[-1]), float(values[0])


def linear_map(integrator: str, h_omega: float) -> LinearMap:
    """The step of an integrator on the harmonic oscillator at hω.

    Args:
        integrator: a registered name or ``"module:Class"``.
        h_omega: step times natural frequency.
    """
    rows = _matrices(integrator, np.array([h_omega]))[0].tolist()
    return LinearMap(h_omega, tuple(tuple(row) for row in rows))  # type: ignore[arg-type]


def stability_limit(integrator: str) -> float:
    """Largest hω up to which no motion of the harmonic oscillator grows.

    0 for a method that makes it grow at every step, ``inf`` for one stable up to
    :data:`LARGEST`. Found by a scan from 0.01 and bisection.

    Args:
        integrator: a registered name or ``"module:Class"``.

    Source: Hairer, Lubich and Wanner, *Geometric Numerical Integration*, 2nd ed., I.5.2.
    """
    grid = np.geomspace(1e-2, LARGEST, 801)
    return _edge(lambda steps: _stable(integrator, steps), grid, 1e-12)[0]


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

    def stable(steps: Array) -> npt.NDArray[np.bool_]:
        return np.array([_loop_stable(integrator, plant, gain, dt) for dt in steps])

    return _edge(stable, np.geomspace(smallest, largest, 60), 1e-6)[1]


def _edge(
    stable: Callable[[Array], npt.NDArray[np.bool_]], grid: Array, tolerance: float
) -> tuple[float, float]:
    """Where stability first ends on a grid: a stable value and an unstable one, by bisection.

    (0, the first) where none is stable before it, (``inf``, ``inf``) where all are.
    """
    unstable = np.flatnonzero(~stable(grid))
    if not len(unstable):
        return math.inf, math.inf
    high = grid[unstable[0]]
    if unstable[0] == 0:
        return 0.0, float(high)
    low = grid[unstable[0] - 1]
    while high - low > tolerance * high:
        middle = 0.5 * (low + high)
        if stable(np.array([middle]))[0]:
            low = middle
        else:
            high = middle
    return float(low), float(high)


def _matrices(integrator: str, h_omega: Array) -> Array:
    """Steps at several hω, shape (len(h_omega), 2, 2)."""
    plant = Oscillator()
    columns = [
        advance_lanes(integrator, plant, np.tile(basis, (len(h_omega), 1)), h_omega)
        for basis in np.eye(2)
    ]
    return np.stack(columns, axis=-1)


def _stable(integrator: str, h_omega: Array) -> npt.NDArray[np.bool_]:
    """Both roots of λ² − tr λ + det within the unit circle, by Jury's criterion.

    The criterion stays sharp where the two roots meet, which eigenvalues do not.
    """
    steps = _matrices(integrator, h_omega)
    trace = np.trace(steps, axis1=1, axis2=2)
    with np.errstate(all="ignore"):
        determinant = np.linalg.det(steps)
    return np.asarray(
        (determinant <= 1.0 + _TOLERANCE) & (np.abs(trace) <= 1.0 + determinant + _TOLERANCE)
    )


def _loop_stable(integrator: str, plant: Plant, gain: Array, dt: float) -> bool:
    def one_step(points: Array) -> Array:
        return advance_lanes(integrator, plant, points, dt, -(points @ gain[0]))

    roots = np.linalg.eigvals(jacobian(one_step, np.zeros(gain.shape[1])))
    return bool(np.abs(roots).max() <= 1.0 + _LOOP_TOLERANCE)
