"""Methods solved by Newton: implicit Euler, Störmer-Verlet, the implicit midpoint rule."""

from __future__ import annotations

from typing import ClassVar

from ..ops.ops import Component, Components, Ops, along
from .interface import UNLIMITED, LinearTheory, Step, System
from .newton import Solved, VelocityEquation, solve


class ImplicitEuler(Solved):
    r"""Position and velocity both advance with the slopes at the end of the step.

    .. math:: q_1 = q_0 + h v_1, \qquad v_1 = v_0 + h a(q_1, v_1)

    Order 1; L-stable, not symplectic, not reversible. Divides the energy of a harmonic oscillator
    by 1 + h²ω² each step: it drains energy at every step size.
    Source: Hairer and Wanner, *Solving Ordinary Differential Equations II*, 2nd ed., IV.3.
    """

    order: ClassVar[int] = 1
    symplectic: ClassVar[bool] = False
    reversible: ClassVar[bool] = False
    theory: ClassVar[LinearTheory] = LinearTheory(
        "1 / (1 + (hω)²) − 1",
        UNLIMITED,
        UNLIMITED,
        lambda z: 1.0 / (1.0 + z * z),
        passive=True,
    )
    losses_of: ClassVar[str] = "end"
    """End of the step whose rates of loss, times the step, are its losses."""

    def step(
        self,
        ops: Ops,
        system: System,
        q: Components,
        v: Components,
        losses: Components,
        control: Components,
        dt: Component,
    ) -> Step:
        v, *report = solve(VelocityEquation(ops, system, q, v, control, dt, dt), v, self)
        q = along(q, dt, v)
        _, loss_rates = system.rates(ops, q, v, control)
        return Step(q, v, along(losses, dt, loss_rates), *report)


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
        control: Components,
        dt: Component,
    ) -> Step:
        half = 0.5 * dt
        acceleration, loss_rates = system.rates(ops, q, v, control)
        kicked = along(v, half, acceleration)
        losses = along(losses, half, loss_rates)
        drifted = along(q, dt, kicked)
        equation = VelocityEquation(ops, system, drifted, kicked, control, half, 0.0 * dt)
        v, *report = solve(equation, kicked, self)
        _, loss_rates = system.rates(ops, drifted, v, control)
        return Step(drifted, v, along(losses, half, loss_rates), *report)


class ImplicitMidpoint(Solved):
    r"""Advances with the slopes at the midpoint of the step's chord.

    .. math::
        q_1 = q_0 + h \bar v, \quad v_1 = v_0 + h a(\bar q, \bar v), \quad
        \bar q = \tfrac{q_0 + q_1}{2},\ \bar v = \tfrac{v_0 + v_1}{2}

    Order 2, A-stable, reversible; symplectic where the mass matrix is constant. Conserves
    quadratic invariants. The one-stage Gauss-Legendre method.
    Source: Hairer, Lubich and Wanner, *Geometric Numerical Integration*, 2nd ed., I.1.2, VI.4.
    """

    order: ClassVar[int] = 2
    symplectic: ClassVar[bool] = True
    reversible: ClassVar[bool] = True
    theory: ClassVar[LinearTheory] = LinearTheory("conserves the energy", UNLIMITED, UNLIMITED)

    def step(
        self,
        ops: Ops,
        system: System,
        q: Components,
        v: Components,
        losses: Components,
        control: Components,
        dt: Component,
    ) -> Step:
        half = 0.5 * dt
        equation = VelocityEquation(ops, system, q, v, control, half, half)
        middle, *report = solve(equation, v, self)
        acceleration, loss_rates = system.rates(ops, along(q, half, middle), middle, control)
        return Step(
            along(q, dt, along(v, half, acceleration)),
            along(v, dt, acceleration),
            along(losses, dt, loss_rates),
            *report,
        )
