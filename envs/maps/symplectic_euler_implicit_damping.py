"""Symplectic Euler with joint damping taken implicitly."""

from __future__ import annotations

from ..arithmetic.ops import Component, Components, Ops
from ..mechanics.system import PlantSystem
from ._families.linearly_implicit import LinearlyImplicit, damping_slopes


class SymplecticEulerImplicitDamping(LinearlyImplicit):
    r"""Kick with the damping of the end, then drift.

    .. math:: (M + hD)(v_1 - v_0) = h M a(q_0, v_0), \qquad q_1 = q_0 + h v_1

    Order 1. Without damping it is symplectic Euler. Energy lost to damping: the damping force of
    the end times the displacement.
    Source: MuJoCo's documentation, *Computation: Numerical integration*, "Euler".
    """

    def slopes(
        self, ops: Ops, system: PlantSystem, q: Components, v: Components, control: Component
    ) -> tuple[Components, ...]:
        return damping_slopes(ops, system, q, v)
