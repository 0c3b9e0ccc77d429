"""The implicit midpoint rule."""

from __future__ import annotations

from typing import ClassVar

from ..ops.ops import Component, Components, Ops
from .interface import UNLIMITED, LinearTheory, Step, System, along
from .newton import Solved, solve_velocity


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
        control: Component,
        dt: Component,
    ) -> Step:
        half = 0.5 * dt
        middle, *report = solve_velocity(ops, system, q, v, control, half, half)
        acceleration, loss_rates = system.rates(ops, along(q, half, middle), middle, control)
        return Step(
            along(q, dt, along(v, half, acceleration)),
            along(v, dt, acceleration),
            along(losses, dt, loss_rates),
            *report,
        )
