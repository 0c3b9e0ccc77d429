"""Symplectic Euler with all velocity-dependent forces taken implicitly."""

from __future__ import annotations

from typing import ClassVar

from integ_gym.envs.integrators.interface import Step, along
from integ_gym.envs.maps._linearly_implicit import kicked, velocity_slopes
from integ_gym.envs.ops import Component, Components, Ops
from integ_gym.envs.system import PlantSystem


class SymplecticEulerImplicitVelocity:
    r"""Kick with the velocity-dependent forces of the end to first order, then drift.

    .. math:: (I - h\,\partial a/\partial v)(v_1 - v_0) = h a(q_0, v_0), \qquad q_1 = q_0 + h v_1

    Order 1. Coriolis and centrifugal terms are among those forces, so that it differs from
    symplectic Euler on a plant whose mass matrix depends on q, also without damping.
    Source: MuJoCo's documentation, *Computation: Numerical integration*, "implicit".
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
        v = kicked(ops, velocity_slopes(ops, system, q, v, control), v, acceleration, dt)
        q = along(q, dt, v)
        _, loss_rates = system.rates(ops, q, v, control)
        return Step(q, v, along(losses, dt, loss_rates))
