"""Symplectic Euler with all velocity-dependent forces taken implicitly."""

from __future__ import annotations

from ..arithmetic import Component, Components, Ops
from ..mechanics import PlantSystem
from ._families import LinearlyImplicit, velocity_slopes


class SymplecticEulerImplicitVelocity(LinearlyImplicit):
    r"""Kick with the velocity-dependent forces of the end to first order, then drift.

    .. math:: (I - h\,\partial a/\partial v)(v_1 - v_0) = h a(q_0, v_0), \qquad q_1 = q_0 + h v_1

    Order 1. Coriolis and centrifugal terms are among those forces, so that it differs from
    symplectic Euler on a plant whose mass matrix depends on q, also without damping.
    Source: MuJoCo's documentation, *Computation: Numerical integration*, "implicit".
    """

    def slopes(
        self, ops: Ops, system: PlantSystem, q: Components, v: Components, control: Component
    ) -> tuple[Components, ...]:
        return velocity_slopes(ops, system, q, v, control)
