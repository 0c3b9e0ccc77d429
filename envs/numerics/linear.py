"""One step on the harmonic oscillator, as a matrix."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..plants import Oscillator
from .stepping import Array, advance_lanes

LARGEST = 100.0
"""hω up to which stability is examined; a method stable so far counts as stable at any step."""

_SMALLEST = 1e-2
_SCAN = 801
_TOLERANCE = 1e-10
"""Growth per step that counts as rounding."""


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
    grid = np.geomspace(_SMALLEST, LARGEST, _SCAN)
    unstable = np.flatnonzero(~_stable(integrator, grid))
    if not len(unstable):
        return math.inf
    if unstable[0] == 0:
        return 0.0
    low, high = grid[unstable[0] - 1], grid[unstable[0]]
    while high - low > 1e-12 * high:
        middle = 0.5 * (low + high)
        if _stable(integrator, np.array([middle]))[0]:
            low = middle
        else:
            high = middle
    return float(low)


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
