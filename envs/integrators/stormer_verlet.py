"""Störmer-Verlet, kick-drift-kick, for forces that depend on velocity."""

from __future__ import annotations

from typing import ClassVar

from ..ops.ops import Component, Components, Ops
from .interface import UNLIMITED, LinearTheory, Step, System, along
from .newton import Solved, solve_velocity


class StormerVerlet(Solved):
    r"""Half kick, drift, half kick; the second half kick is implicit in the velocity.

    .. math::
        v_{1/2} = v_0 + \tfrac h2 a(q_0, v_0), \quad q_1 = q_0 + h v_{1/2}, \quad
        v_1 = v_{1/2} + \tfrac h2 a(q_1, v_1)

    Order 2 and reversible, also with damping and Coriolis terms: the second half is the adjoint
    of the first. Symplectic where the mass matrix is constant and forces do not depend on
    velocity. Stable on an oscillator for hω < 2. Not the all-explicit variant, which takes both
    kicks at known velocities and falls to order 1 on a cart-pole.
    Source: Hairer, Lubich and Wanner (2003), *Geometric numerical integration illustrated by the
    Störmer-Verlet method*, Acta Numerica 12, equation 1.17 and section 1.6.
    """

    order: ClassVar[int] = 2
    symplectic: ClassVar[bool] = True
    reversible: ClassVar[bool] = True
    theory: ClassVar[LinearTheory] = LinearTheory("conserves a shadow energy", 2.0, UNLIMITED)

    def step(
        self,
        ops: Ops,
        system: System,
        q: Components,
        v: Components,
        losses: Components,
        control: Component,
        dt: Component,
    ) -> Step:
        half = 0.5 * dt
        acceleration, loss_rates = system.rates(ops, q, v, control)
        kicked = along(v, half, acceleration)
        losses = along(losses, half, loss_rates)
        drifted = along(q, dt, kicked)
        v, *report = solve_velocity(ops, system, drifted, kicked, control, half, 0.0 * dt)
        _, loss_rates = system.rates(ops, drifted, v, control)
        return Step(drifted, v, along(losses, half, loss_rates), *report)
