"""Symplectic Euler with joint damping taken implicitly."""

from __future__ import annotations

from typing import ClassVar

from integ_gym.envs.integrators.interface import Step, along
from integ_gym.envs.maps._linearly_implicit import damping_slopes, kicked
from integ_gym.envs.ops import Component, Components, Ops
from integ_gym.envs.system import PlantSystem


class SymplecticEulerImplicitDamping:
    r"""Kick with the damping of the end, then drift.

    .. math:: (M + hD)(v_1 - v_0) = h M a(q_0, v_0), \qquad q_1 = q_0 + h v_1

    Order 1. Without damping it is symplectic Euler. Energy lost to damping: the damping force of
    the end times the displacement.
    Source: MuJoCo's documentation, *Computation: Numerical integration*, "Euler".
    """

    order: ClassVar[int] = 1
    losses_of: ClassVar[str] = "end"
    """End of the step whose rates of loss, times the step, are its losses."""

    def step(
        self,
        ops: Ops,
        system: PlantSystem,
        q: Components,
        v: Components,
        losses: Components,
        control: Component,
        dt: Component,
    ) -> Step:
        acceleration, _ = system.rates(ops, q, v, control)
        v = kicked(ops, damping_slopes(ops, system, q, v), v, acceleration, dt)
        q = along(q, dt, v)
        _, loss_rates = system.rates(ops, q, v, control)
        return Step(q, v, along(losses, dt, loss_rates))
