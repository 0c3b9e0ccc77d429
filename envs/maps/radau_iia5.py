"""The three-stage Radau IIA method."""

from __future__ import annotations

from typing import ClassVar

from ._families.runge_kutta import ImplicitRungeKutta, Tableau

_R = 6.0**0.5
_LAST = ((16.0 - _R) / 36.0, (16.0 + _R) / 36.0, 1.0 / 9.0)


class RadauIIA5(ImplicitRungeKutta):
    """Collocation at two points within the step and at its end.

    Order 5, L-stable; not symplectic, not reversible: it drains energy very slowly. At a fixed
    step, unlike the program RADAU5, which chooses its steps.
    Source: Hairer and Wanner, *Solving Ordinary Differential Equations II*, 2nd ed., table IV.5.6.
    """

    order: ClassVar[int] = 5
    tableau: ClassVar[Tableau] = Tableau(
        (
            ((88.0 - 7.0 * _R) / 360.0, (296.0 - 169.0 * _R) / 1800.0, (3.0 * _R - 2.0) / 225.0),
            ((296.0 + 169.0 * _R) / 1800.0, (88.0 + 7.0 * _R) / 360.0, -(2.0 + 3.0 * _R) / 225.0),
            _LAST,
        ),
        _LAST,
    )
