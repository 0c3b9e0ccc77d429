"""The fifth-order method of Dormand and Prince."""

from __future__ import annotations

from typing import ClassVar

from ._families.runge_kutta import ExplicitRungeKutta, Tableau


class DormandPrince5(ExplicitRungeKutta):
    """The fifth-order half of the 5(4) pair, at a fixed step.

    Order 5; not symplectic, not reversible. The seventh stage of the pair serves the error estimate
    alone. Known as DOPRI5, RK45 and ode45.
    Source: Dormand and Prince (1980); Hairer, Nørsett and Wanner, *Solving Ordinary Differential
    Equations I*, 2nd ed., table II.5.2.
    """

    order: ClassVar[int] = 5
    tableau: ClassVar[Tableau] = Tableau(
        (
            (),
            (1 / 5,),
            (3 / 40, 9 / 40),
            (44 / 45, -56 / 15, 32 / 9),
            (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
            (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
        ),
        (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
    )
