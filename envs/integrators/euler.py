"""Explicit and symplectic Euler."""

from __future__ import annotations

from typing import ClassVar

from ..ops.ops import Component, Components, Ops, along
from .interface import LinearTheory, Step, System


class ExplicitEuler:
    r"""Position and velocity both advance with the slopes at the start of the step.

    .. math:: q_1 = q_0 + h v_0, \qquad v_1 = v_0 + h a(q_0, v_0)

    Order 1; not symplectic, not reversible. Multiplies the energy of a harmonic oscillator by
    1 + h²ω² each step: it pumps energy in at every step size. Gymnasium's ``CartPole-v1``.
    Source: Hairer, Lubich and Wanner, *Geometric Numerical Integration*, 2nd ed., I.1.2.
    """

    order: ClassVar[int] = 1
    symplectic: ClassVar[bool] = False
    reversible: ClassVar[bool] = False
    theory: ClassVar[LinearTheory] = LinearTheory("(hω)²", 0.0, 2.0, lambda z: 1.0 + z * z)
    losses_of: ClassVar[str] = "start"
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
        acceleration, loss_rates = system.rates(ops, q, v, control)
        return Step(along(q, dt, v), along(v, dt, acceleration), along(losses, dt, loss_rates))


class SymplecticEuler:
    r"""Kick, then drift: the velocity first, then the position with the new velocity.

    .. math:: v_1 = v_0 + h a(q_0, v_0), \qquad q_1 = q_0 + h v_1

    Order 1; symplectic where the mass matrix is constant and forces do not depend on velocity,
    not reversible. There the energy error stays bounded; on a cart-pole in (q, v) the map is not
    symplectic and drains energy. Gymnasium's ``Pendulum-v1`` and the scheme of most game and
    robotics engines. Stable on an oscillator for hω < 2.
    A speed limit acts between kick and drift, as in Gymnasium.
    Source: Hairer, Lubich and Wanner, *Geometric Numerical Integration*, 2nd ed., I.1.2, VI.3.
    """

    order: ClassVar[int] = 1
    symplectic: ClassVar[bool] = True
    reversible: ClassVar[bool] = False
    theory: ClassVar[LinearTheory] = LinearTheory("conserves a shadow energy", 2.0, 2.0)
    losses_of: ClassVar[str] = "start"
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
        acceleration, loss_rates = system.rates(ops, q, v, control)
        kicked = along(v, dt, acceleration)
        drifted = along(q, dt, system.limit(ops, kicked))
        return Step(drifted, kicked, along(losses, dt, loss_rates))
