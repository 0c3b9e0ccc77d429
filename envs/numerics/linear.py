"""Linear stability: of the harmonic oscillator, and of a plant under a linear feedback."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..plants._oscillator import Oscillator
from ..plants.interface import Plant
from .stepping import Array, advance_lanes, jacobian

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
