"""The driven, damped pendulum."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from integ_gym.support.parameters import nonnegative, one_of, optional, parameter, positive

from ..mechanics import Friction, Link, Mechanism, Slopes, friction_of
from ..ops.ops import Component, Components, Ops
from .contact import Stops, stops_at
from .interface import MASS_DISTRIBUTIONS


@dataclass(frozen=True)
class Pendulum:
    r"""A rigid pendulum on a fixed hinge, angle measured from upright, positive counter-clockwise.

    .. math:: I\ddot\theta = m g c \sin\theta - b\dot\theta + \tau

    with :math:`c = L/2,\ I = mL^2/3` for a uniform rod (Gymnasium's ``Pendulum-v1``) and
    :math:`c = L,\ I = mL^2` for a point mass. State (θ, θ̇); control: torque τ at the hinge.
    Source: Goldstein, *Classical Mechanics*, section 5.
    """

    mass: float = parameter(1.0, "kg", "mass of the rod or bob", positive)
    length: float = parameter(1.0, "m", "hinge to far end of the rod, or to the bob", positive)
    gravity: float = parameter(10.0, "m/s^2", "gravitational acceleration", nonnegative)
    damping: float = parameter(0.0, "N m s/rad", "viscous damping at the hinge", nonnegative)
    friction: float = parameter(0.0, "N m", "dry friction at the hinge", nonnegative)
    friction_speed: float = parameter(
        0.01, "rad/s", "speed over which friction changes its sign", positive
    )
    joint_limit: float | None = parameter(
        None,
        "rad",
        "stops at ±`joint_limit` from upright, turns counted; `None`: no stops",
        optional(positive),
    )
    stop_stiffness: float = parameter(200.0, "N m/rad", "stiffness of the stops", positive)
    stop_damping: float = parameter(0.1, "s/rad", "damping of the stops", nonnegative)
    mass_distribution: str = parameter(
        "uniform", "", "`uniform` rod or `point` mass at the end", one_of(*MASS_DISTRIBUTIONS)
    )

    name: ClassVar[str] = "pendulum"
    coordinates: ClassVar[tuple[str, ...]] = ("theta",)
    velocities: ClassVar[tuple[str, ...]] = ("theta_dot",)
    coordinate_units: ClassVar[tuple[str, ...]] = ("rad",)
    controls: ClassVar[tuple[tuple[str, str], ...]] = (("torque", "N m"),)
    frame: ClassVar[str] = "hinge; theta = 0 upright, positive counter-clockwise"
    actuated: ClassVar[tuple[int, ...]] = (0,)
    stopped: ClassVar[int] = 0
    constant_mass_matrix: ClassVar[bool] = True

    @cached_property
    def inertia(self) -> Component:
        """Moment of inertia about the hinge, kg m^2."""
        factor = 1.0 if self.mass_distribution == "point" else 1.0 / 3.0
        return factor * self.mass * self.length * self.length

    @cached_property
    def gravity_torque(self) -> Component:
        """m g c, the largest torque of gravity, N m."""
        arm = 1.0 if self.mass_distribution == "point" else 0.5
        return self.mass * self.gravity * (arm * self.length)

    @cached_property
    def mechanism(self) -> Mechanism:
        """The rod or bob on its hinge."""
        point = self.mass_distribution == "point"
        centre = self.length if point else 0.5 * self.length
        inertia = 0.0 if point else self.mass * self.length * self.length / 12.0
        link = Link("theta", "hinge", self.mass, centre, inertia, self.damping)
        return Mechanism((link,), self.gravity)

    @cached_property
    def stops(self) -> Stops | None:
        """Stops on the unwrapped angle, or None."""
        return stops_at(self.stopped, self.joint_limit, self.stop_stiffness, self.stop_damping)

    @cached_property
    def dry_friction(self) -> Friction | None:
        """Friction at the hinge, or None."""
        return friction_of((self.friction,), self.friction_speed)

    @cached_property
    def _gravity_rate(self) -> Component:
        return self.gravity_torque / self.inertia

    @cached_property
    def _inverse_inertia(self) -> Component:
        return 1.0 / self.inertia

    def acceleration(self, ops: Ops, q: Components, v: Components, force: Components) -> Components:
        """Angular acceleration, rad/s^2, as a 1-tuple."""
        drive = force[0] - self.damping * v[0]
        return (self._gravity_rate * ops.sin(q[0]) + self._inverse_inertia * drive,)

    def jacobian(self, ops: Ops, q: Components, v: Components, force: Components) -> Slopes:
        """(∂a/∂q, ∂a/∂v), each a 1×1 nested tuple."""
        by_q = self._gravity_rate * ops.cos(q[0])
        return ((by_q,),), ((-self.damping * self._inverse_inertia + 0.0 * by_q,),)

    def energy(self, ops: Ops, q: Components, v: Components) -> Component:
        """Kinetic plus potential energy, J; zero at rest hanging."""
        return 0.5 * self.inertia * v[0] * v[0] + self.gravity_torque * (1.0 + ops.cos(q[0]))

    def dissipation(self, ops: Ops, q: Components, v: Components) -> Component:
        """Power taken out by damping, W, never negative."""
        return self.damping * v[0] * v[0]

    def mass_matrix(self, ops: Ops, q: Components) -> tuple[Components, ...]:
        """1×1 mass matrix, kg m^2."""
        return ((self.inertia,),)
