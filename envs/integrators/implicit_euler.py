"""Implicit (backward) Euler."""

from __future__ import annotations

from typing import ClassVar

from ..ops.ops import Component, Components, Ops
from .interface import UNLIMITED, LinearTheory, Step, System, along
from .newton import Solved, solve_velocity


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
        control: Component,
        dt: Component,
    ) -> Step:
        v, *report = solve_velocity(ops, system, q, v, control, dt, dt)
        q = along(q, dt, v)
        _, loss_rates = system.rates(ops, q, v, control)
        return Step(q, v, along(losses, dt, loss_rates), *report)
