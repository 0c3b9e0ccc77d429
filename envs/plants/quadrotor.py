"""The planar quadrotor: a rigid body that two rotors carry."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from integ_gym.support.parameters import nonnegative, optional, parameter, positive

from ..mechanics import Mechanism, floating_body
from ..ops.ops import Component, Components, Ops
from .interface import add_border


@dataclass(frozen=True)
class Quadrotor:
    r"""A quadrotor in a vertical plane; each rotor stands for the pair on its side.

    .. math::
        m\ddot x &= (T_l + T_r)\sin\theta - b\dot x \\
        m\ddot z &= (T_l + T_r)\cos\theta - b\dot z - m g \\
        J\ddot\theta &= a (T_l - T_r), \qquad \dot T_i = (u_i - T_i) / \tau

    z is upwards, and θ is the pitch from level, positive towards +x. The thrusts T follow the
    commanded ones u with a first-order lag τ. They are velocities of coordinates of their own,
    the impulses that the rotors have delivered, N s. These coordinates have no mass, no
    energy, no part in the work, which is that of the thrusts on the body. Without a lag
    (``motor_time_constant=None``) the commanded thrusts act at once, and the two thrusts in the
    state stay what they were at the start. State (x, ẋ, z, ż, θ, θ̇, impulse and thrust of the left
    rotor, of the right one). There is no rest without control: the body falls.
    Source of the equations and of mass, arm and inertia: Bouabdallah (2007), *Design and control of
    quadrotors with application to autonomous flying*, EPFL thesis 3727.
    """

    mass: float = parameter(0.65, "kg", "mass of the body with its rotors", positive)
    arm: float = parameter(0.23, "m", "rotor to centre of mass", positive)
    inertia: float = parameter(0.0075, "kg m^2", "moment of inertia in pitch", positive)
    gravity: float = parameter(9.81, "m/s^2", "gravitational acceleration", nonnegative)
    damping: float = parameter(0.1, "N s/m", "linear drag of the body", nonnegative)
    motor_time_constant: float | None = parameter(
        0.05, "s", "lag of the thrusts; `None`: they act at once", optional(positive)
    )

    name: ClassVar[str] = "quadrotor"
    coordinates: ClassVar[tuple[str, ...]] = ("x", "z", "theta", "left_impulse", "right_impulse")
    velocities: ClassVar[tuple[str, ...]] = (
        "x_dot", "z_dot", "theta_dot", "left_thrust", "right_thrust",
    )  # fmt: skip
    coordinate_units: ClassVar[tuple[str, ...]] = ("m", "m", "rad", "N s", "N s")
    velocity_units: ClassVar[tuple[str, ...]] = ("m/s", "m/s", "rad/s", "N", "N")
    controls: ClassVar[tuple[tuple[str, str], ...]] = (("left_thrust", "N"), ("right_thrust", "N"))
    frame: ClassVar[str] = "target; x to the right, z upwards, theta = 0 level, positive towards +x"
    actuated: ClassVar[tuple[int, ...]] = (3, 4)
    massless: ClassVar[tuple[int, ...]] = (3, 4)
    hands: ClassVar[tuple[tuple[float, ...], ...]] = ((0.02, -0.02), (0.3, 0.3))
    constant_mass_matrix: ClassVar[bool] = True

    @cached_property
    def mechanism(self) -> Mechanism:
        """The body; the lag of its rotors is no link."""
        return Mechanism(floating_body(self.mass, self.inertia, self.damping), self.gravity)

    @cached_property
    def weight(self) -> Component:
        """m g, N."""
        return self.mass * self.gravity

    @cached_property
    def _inverse_mass(self) -> Component:
        return 1.0 / self.mass

    def input_forces(
        self, ops: Ops, q: Components, v: Components, controls: Components
    ) -> Components:
        """Forces of the thrusts on the body, N and N m, and the rates of the thrusts, N/s."""
        if self.motor_time_constant is None:
            left, right = controls
            rates = (0.0 * left, 0.0 * right)
        else:
            left, right = v[3], v[4]
            rates = (
                (controls[0] - left) / self.motor_time_constant,
                (controls[1] - right) / self.motor_time_constant,
            )
        lift = left + right
        return lift * ops.sin(q[2]), lift * ops.cos(q[2]), self.arm * (left - right), *rates

    def acceleration(self, ops: Ops, q: Components, v: Components, force: Components) -> Components:
        """(ẍ, z̈, θ̈) in m/s^2 and rad/s^2, and the rates of the thrusts, N/s."""
        return (
            (force[0] - self.damping * v[0]) * self._inverse_mass,
            (force[1] - self.damping * v[1] - self.weight) * self._inverse_mass,
            force[2] / self.inertia,
            force[3],
            force[4],
        )

    def energy(self, ops: Ops, q: Components, v: Components) -> Component:
        """Kinetic plus potential energy of the body, J; zero at rest at z = 0."""
        moving = self.mass * (v[0] * v[0] + v[1] * v[1]) + self.inertia * v[2] * v[2]
        return 0.5 * moving + self.weight * q[1]

    def dissipation(self, ops: Ops, q: Components, v: Components) -> Component:
        """Power taken out by drag, W, never negative."""
        return self.damping * (v[0] * v[0] + v[1] * v[1])

    def mass_matrix(self, ops: Ops, q: Components) -> tuple[Components, ...]:
        """5×5 mass matrix, diag(m, m, J, 0, 0): kg, kg, kg m^2."""
        zero = 0.0 * self.mass
        diagonal = (self.mass, self.mass, self.inertia, zero, zero)
        return tuple(
            tuple(entry if i == j else zero for j in range(5)) for i, entry in enumerate(diagonal)
        )


@dataclass(frozen=True)
class GuidedQuadrotor(Quadrotor):
    """The quadrotor, and the clock of a guide that shows it one way-point after the other.

    The guide's phase φ is a coordinate that nothing acts on, as that of the marker of
    :class:`integ_gym.envs.plants.double_pendulum.ReachingArm`. φ and φ̇ are last in the state.
    """

    name: ClassVar[str] = "guided_quadrotor"
    coordinates: ClassVar[tuple[str, ...]] = (*Quadrotor.coordinates, "guide_phase")
    velocities: ClassVar[tuple[str, ...]] = (*Quadrotor.velocities, "guide_rate")
    coordinate_units: ClassVar[tuple[str, ...]] = (*Quadrotor.coordinate_units, "rad")
    velocity_units: ClassVar[tuple[str, ...]] = (*Quadrotor.velocity_units, "rad/s")
    frame: ClassVar[str] = Quadrotor.frame.replace("target", "middle of the room")
    massless: ClassVar[tuple[int, ...]] = (3, 4, 5)

    def input_forces(
        self, ops: Ops, q: Components, v: Components, controls: Components
    ) -> Components:
        """Those of the quadrotor, and none on the clock."""
        return *super().input_forces(ops, q, v, controls), 0.0 * q[5]

    def acceleration(self, ops: Ops, q: Components, v: Components, force: Components) -> Components:
        """(ẍ, z̈, θ̈), the rates of the thrusts, and φ̈ in rad/s^2."""
        return *super().acceleration(ops, q, v, force), force[5]

    def mass_matrix(self, ops: Ops, q: Components) -> tuple[Components, ...]:
        """6×6 mass matrix; 0 of the clock."""
        return add_border(super().mass_matrix(ops, q), 0.0 * q[5])
