"""The two-stage Radau IIA method."""

from __future__ import annotations

from typing import ClassVar

from ..arithmetic.ops import Component, Components, Ops
from ..integrators.interface import State, System
from ._families.runge_kutta import ImplicitRungeKutta, Tableau, along_row


class RadauIIA3(ImplicitRungeKutta):
    """Collocation at one third and at the end of the step.

    Order 3, L-stable; not symplectic, not reversible: it drains energy slowly. The one-stage
    method of the family is implicit Euler.
    Source: Hairer and Wanner, *Solving Ordinary Differential Equations II*, 2nd ed., table IV.5.5.
    """

    order: ClassVar[int] = 3
    tableau: ClassVar[Tableau] = Tableau(((5 / 12, -1 / 12), (3 / 4, 1 / 4)), (3 / 4, 1 / 4))

    def losses_between(
        self,
        ops: Ops,
        system: System,
        start: State,
        end: State,
        losses: Components,
        control: Component,
        dt: Component,
    ) -> Components:
        """``losses`` after a step of this map of which both ends are known.

        The end is its second stage, and from the two the slope of the first follows.
        """
        (q, v), (end_q, end_v) = start, end
        row, weights = self.tableau.stages
        last, last_powers = system.rates(ops, end_q, end_v, control)
        changes = [(b - a) / dt for a, b in zip(v, end_v, strict=True)]
        pairs = zip(changes, last, strict=True)
        first = tuple([(mean - weights[1] * a) / weights[0] for mean, a in pairs])
        speeds = along_row(v, dt, row, (first, last))
        _, powers = system.rates(ops, along_row(q, dt, row, (speeds, end_v)), speeds, control)
        return along_row(losses, dt, weights, (powers, last_powers))
