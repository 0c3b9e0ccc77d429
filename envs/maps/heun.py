"""Heun's second-order method."""

from __future__ import annotations

from typing import ClassVar

from ._families.runge_kutta import ExplicitRungeKutta, Tableau


class Heun(ExplicitRungeKutta):
    """Slopes at the start and at the end of an explicit Euler step, averaged.

    Order 2; not symplectic, not reversible. Also called the explicit trapezoidal rule.
    Source: Heun (1900); Hairer, Nørsett and Wanner, *Solving Ordinary Differential Equations I*,
    2nd ed., table II.1.1.
    """

    order: ClassVar[int] = 2
    tableau: ClassVar[Tableau] = Tableau(((), (1.0,)), (0.5, 0.5))
