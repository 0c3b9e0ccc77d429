"""The two-stage Gauss-Legendre method."""

from __future__ import annotations

from typing import ClassVar

from ._families.runge_kutta import ImplicitRungeKutta, Tableau

_S = 3.0**0.5 / 6.0


class GaussLegendre4(ImplicitRungeKutta):
    """Collocation at the two Gauss points of the step, symmetric about its middle.

    Order 4, A-stable, reversible; symplectic where the mass matrix is constant. Conserves quadratic
    invariants. The one-stage method of the family is the implicit midpoint rule.
    Source: Hairer, Lubich and Wanner, *Geometric Numerical Integration*, 2nd ed., II.1.3 and VI.4.
    """

    order: ClassVar[int] = 4
    symplectic: ClassVar[bool] = True
    reversible: ClassVar[bool] = True
    tableau: ClassVar[Tableau] = Tableau(((0.25, 0.25 - _S), (0.25 + _S, 0.25)), (0.5, 0.5))
