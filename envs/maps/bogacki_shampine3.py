"""The third-order method of Bogacki and Shampine."""

from __future__ import annotations

from typing import ClassVar

from ._families.runge_kutta import ExplicitRungeKutta, Tableau


class BogackiShampine3(ExplicitRungeKutta):
    """The third-order half of the 3(2) pair, at a fixed step.

    Order 3; not symplectic, not reversible. Its stages are Ralston's; the fourth of the pair serves
    the error estimate alone.
    Source: Bogacki and Shampine (1989), *A 3(2) pair of Runge-Kutta formulas*, Applied Mathematics
    Letters 2.
    """

    order: ClassVar[int] = 3
    tableau: ClassVar[Tableau] = Tableau(
        ((), (0.5,), (0.0, 0.75)), (2.0 / 9.0, 1.0 / 3.0, 4.0 / 9.0)
    )
