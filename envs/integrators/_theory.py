"""What an integrator may declare of itself on linear problems."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

UNLIMITED = float("inf")
"""Where there is no limit of stability."""


def _one(z: float) -> float:
    return 1.0


@dataclass(frozen=True)
class LinearTheory:
    r"""What theory says of an integrator on linear problems.

    On the oscillator :math:`\ddot x = -\omega^2 x` one step of size h depends on
    :math:`z = h\omega` alone, on the decay :math:`\dot v = -\lambda v` on :math:`z = h\lambda`.
    Sources: Hairer, Lubich and Wanner, *Geometric Numerical Integration*, 2nd ed., I.1 and I.5.2;
    Hairer and Wanner, *Solving Ordinary Differential Equations II*, 2nd ed., IV.2 and IV.3.

    Attributes:
        formula: the energy factor less 1, in words.
        oscillation_limit: largest z = hω at which no oscillation grows.
        decay_limit: largest z = hλ at which a damped velocity does not grow.
        energy_factor: factor on the oscillator's energy per step in the long run, of z = hω.
        passive: whether a step takes energy out of every convex potential.
    """

    formula: str
    oscillation_limit: float
    decay_limit: float
    energy_factor: Callable[[float], float] = _one
    passive: bool = False
