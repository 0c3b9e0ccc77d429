"""The two-stage Radau IIA method."""

from __future__ import annotations

from typing import ClassVar

from integ_gym.envs.maps._runge_kutta import ImplicitRungeKutta, Tableau


class RadauIIA3(ImplicitRungeKutta):
    """Collocation at one third and at the end of the step.

    Order 3, L-stable; not symplectic, not reversible: it drains energy slowly. The one-stage
    method of the family is implicit Euler.
    Source: Hairer and Wanner, *Solving Ordinary Differential Equations II*, 2nd ed., table IV.5.5.
    """

    order: ClassVar[int] = 3
    symplectic: ClassVar[bool] = False
    reversible: ClassVar[bool] = False
    tableau: ClassVar[Tableau] = Tableau(((5 / 12, -1 / 12), (3 / 4, 1 / 4)), (3 / 4, 1 / 4))
