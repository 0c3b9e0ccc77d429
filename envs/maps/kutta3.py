"""Kutta's third-order method."""

from __future__ import annotations

from typing import ClassVar

from ._families.runge_kutta import ExplicitRungeKutta, Tableau


class Kutta3(ExplicitRungeKutta):
    """Slopes at the start, in the middle and at the end, with the weights of Simpson's rule.

    Order 3; not symplectic, not reversible.
    Source: Kutta (1901), *Beitrag zur näherungsweisen Integration totaler Differentialgleichungen*,
    Zeitschrift für Mathematik und Physik 46.
    """

    order: ClassVar[int] = 3
    tableau: ClassVar[Tableau] = Tableau(
        ((), (0.5,), (-1.0, 2.0)), (1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0)
    )
