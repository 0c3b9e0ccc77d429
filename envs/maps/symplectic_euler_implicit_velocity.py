"""Symplectic Euler with all velocity-dependent forces taken implicitly."""

from __future__ import annotations

from ..arithmetic.ops import Component, Components, Ops
from ..mechanics.system import PlantSystem
from ._families.linearly_implicit import LinearlyImplicit


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
        """∂a/∂v; the differences are exact, for accelerations are quadratic in the velocity."""
        columns = []
        for j, x in enumerate(v):
            above, _ = system.rates(ops, q, (*v[:j], x + 0.5, *v[j + 1 :]), control)
            below, _ = system.rates(ops, q, (*v[:j], x - 0.5, *v[j + 1 :]), control)
            columns.append([a - b for a, b in zip(above, below, strict=True)])
        return tuple(zip(*columns, strict=True))
