r"""What theory says of the built-in integrators on linear problems.

On the oscillator :math:`\ddot x = -\omega^2 x` one step of size h depends on :math:`z = h\omega`
alone, on the decay :math:`\dot v = -\lambda v` on :math:`z = h\lambda`.
Sources: Hairer, Lubich and Wanner, *Geometric Numerical Integration*, 2nd ed., I.1 and I.5.2;
Hairer and Wanner, *Solving Ordinary Differential Equations II*, 2nd ed., IV.2 and IV.3.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, sqrt


@dataclass(frozen=True)
class LinearTheory:
    """An integrator on linear problems.

    Attributes:
        energy_factor: factor on the oscillator's energy per step in the long run, of z = hω.
        formula: the factor less 1, in words.
        oscillation_limit: largest z = hω at which no oscillation grows.
        decay_limit: largest z = hλ at which a damped velocity does not grow.
        passive: whether a step takes energy out of every convex potential.
    """

    energy_factor: Callable[[float], float]
    formula: str
    oscillation_limit: float
    decay_limit: float
    passive: bool = False


def _one(z: float) -> float:
    return 1.0


_CONSERVED = "conserves a shadow energy"

_RK4_DECAY = 2.785293563405282
"""Real root of R(-z) = 1 of the classical Runge-Kutta method."""

THEORY = {
    "explicit_euler": LinearTheory(lambda z: 1.0 + z * z, "(hω)²", 0.0, 2.0),
    "implicit_euler": LinearTheory(
        lambda z: 1.0 / (1.0 + z * z), "1 / (1 + (hω)²) − 1", inf, inf, passive=True
    ),
    "symplectic_euler": LinearTheory(_one, _CONSERVED, 2.0, 2.0),
    "stormer_verlet": LinearTheory(_one, _CONSERVED, 2.0, inf),
    "implicit_midpoint": LinearTheory(_one, "conserves the energy", inf, inf),
    "rk4": LinearTheory(
        lambda z: 1.0 - z**6 / 72.0 + z**8 / 576.0,
        "−(hω)⁶/72 + (hω)⁸/576",
        2.0 * sqrt(2.0),
        _RK4_DECAY,
    ),
    "reference": LinearTheory(_one, "the exact motion", inf, inf),
}
"""Integrator to its theory; a user's own integrator has none."""
