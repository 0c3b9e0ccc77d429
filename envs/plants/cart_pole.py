"""The cart-pole: a pole hinged on a force-driven cart."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from integ_gym.support.parameters import nonnegative, one_of, optional, parameter, positive

from ..mechanics import Friction, Link, Mechanism, friction_of
from ..ops.ops import Component, Components, Ops
from .contact import Stops, stops_at
from .interface import MASS_DISTRIBUTIONS


@dataclass(frozen=True)
class CartPole:
    r"""A pole on a cart on a horizontal track, pole angle measured from upright.

    .. math::
        (M+m)\ddot x + m l\cos\theta\,\ddot\theta &= F - b_x\dot x + m l\dot\theta^2\sin\theta \\
        m l\cos\theta\,\ddot x + I\ddot\theta &= m g l\sin\theta - b_\theta\dot\theta

    with l the distance from hinge to centre of mass (half the pole's length, as in Gymnasium's
    ``CartPole-v1``) and :math:`I = \tfrac43 m l^2` for a uniform pole, :math:`m l^2` for a point
    mass at l. State (x, ẋ, θ, θ̇); control: horizontal force F on the cart. The mass matrix
    depends on θ, so (q, v) maps of symplectic integrators are not symplectic here.
    Source: Florian (2007), *Correct equations for the dynamics of the cart-pole system*,
    without the friction between cart and track.
    """

    cart_mass: float = parameter(1.0, "kg", "mass of the cart", positive)
    mass: float = parameter(0.1, "kg", "mass of the pole", positive)
    length: float = parameter(0.5, "m", "hinge to centre of mass of the pole", positive)
    gravity: float = parameter(9.8, "m/s^2", "gravitational acceleration", nonnegative)
    damping: float = parameter(0.0, "N m s/rad", "viscous damping at the hinge", nonnegative)
    cart_damping: float = parameter(0.0, "N s/m", "viscous damping of the cart", nonnegative)
    friction: float = parameter(0.0, "N m", "dry friction at the hinge", nonnegative)
    cart_friction: float = parameter(0.0, "N", "dry friction of the cart", nonnegative)
    friction_speed: float = parameter(
        0.01, "rad/s, m/s", "speed over which friction changes its sign", positive
    )
    track_limit: float | None = parameter(
        None, "m", "stops at ±`track_limit`; `None`: no stops", optional(positive)
    )
    stop_stiffness: float = parameter(2000.0, "N/m", "stiffness of the stops", positive)
    stop_damping: float = parameter(0.5, "s/m", "damping of the stops", nonnegative)
    mass_distribution: str = parameter(
        "uniform",
        "",
        "`uniform` pole or `point` mass at its centre of mass",
        one_of(*MASS_DISTRIBUTIONS),
    )

    name: ClassVar[str] = "cart_pole"
    coordinates: ClassVar[tuple[str, ...]] = ("x", "theta")
    velocities: ClassVar[tuple[str, ...]] = ("x_dot", "theta_dot")
    coordinate_units: ClassVar[tuple[str, ...]] = ("m", "rad")
    controls: ClassVar[tuple[tuple[str, str], ...]] = (("force", "N"),)
    frame: ClassVar[str] = "track; x = 0 at its middle, theta = 0 upright, positive towards +x"
    actuated: ClassVar[tuple[int, ...]] = (0,)
    stopped: ClassVar[int] = 0
    constant_mass_matrix: ClassVar[bool] = False

    @cached_property
    def total_mass(self) -> Component:
        """Cart plus pole, kg."""
        return self.cart_mass + self.mass

    @cached_property
    def mass_moment(self) -> Component:
        """m l, kg m."""
        return self.mass * self.length

    @cached_property
    def inertia(self) -> Component:
        """Moment of inertia of the pole about its hinge, kg m^2."""
        factor = 1.0 if self.mass_distribution == "point" else 4.0 / 3.0
        return factor * self.mass * self.length * self.length

    @cached_property
    def mechanism(self) -> Mechanism:
        """The cart on its track and the pole on the cart."""
        point = self.mass_distribution == "point"
        inertia = 0.0 if point else self.mass * self.length * self.length / 3.0
        cart = Link("x", "slide", self.cart_mass, 0.0, 0.0, self.cart_damping)
        pole = Link("theta", "hinge", self.mass, self.length, inertia, self.damping)
        return Mechanism((cart, pole), self.gravity)

    @cached_property
    def stops(self) -> Stops | None:
        """Stops at the ends of the track, or None."""
        return stops_at(self.stopped, self.track_limit, self.stop_stiffness, self.stop_damping)

    @cached_property
    def dry_friction(self) -> Friction | None:
        """Friction of the cart and at the hinge, or None."""
        return friction_of((self.cart_friction, self.friction), self.friction_speed)

    @cached_property
    def _weight_moment(self) -> Component:
        return self.mass_moment * self.gravity

    @cached_property
    def _inverse_total_mass(self) -> Component:
        return 1.0 / self.total_mass

    def acceleration(self, ops: Ops, q: Components, v: Components, force: Components) -> Components:
        """(ẍ, θ̈) in m/s^2 and rad/s^2."""
        sine, cosine = ops.sin(q[1]), ops.cos(q[1])
        coupling = self.mass_moment * cosine
        push = force[0] - self.cart_damping * v[0] + self.mass_moment * v[1] * v[1] * sine
        torque = force[1] - self.damping * v[1] + self._weight_moment * sine
        share = push * self._inverse_total_mass
        angular = (torque - coupling * share) / (
            self.inertia - coupling * coupling * self._inverse_total_mass
        )
        return share - coupling * angular * self._inverse_total_mass, angular

    def energy(self, ops: Ops, q: Components, v: Components) -> Component:
        """Kinetic plus potential energy, J; zero at rest with the pole hanging."""
        cosine = ops.cos(q[1])
        kinetic = (
            0.5 * self.total_mass * v[0] * v[0]
            + self.mass_moment * cosine * v[0] * v[1]
            + 0.5 * self.inertia * v[1] * v[1]
        )
        return kinetic + self._weight_moment * (1.0 + cosine)

    def dissipation(self, ops: Ops, q: Components, v: Components) -> Component:
        """Power taken out by both dampers, W, never negative."""
        return self.damping * v[1] * v[1] + self.cart_damping * v[0] * v[0]

    def mass_matrix(self, ops: Ops, q: Components) -> tuple[Components, ...]:
        """2×2 mass matrix, (kg, kg m; kg m, kg m^2)."""
        coupling = self.mass_moment * ops.cos(q[1])
        return (self.total_mass, coupling), (coupling, self.inertia)
