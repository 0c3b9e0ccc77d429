"""The planar one-legged hopper: a torso on a springy leg that touches the ground."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from integ_gym.support.parameters import nonnegative, parameter, positive

from ..mechanics import Link, Mechanism, floating_body
from ..ops.ops import Component, Components, Ops
from .contact import ContactFrame, ContactPoint


@dataclass(frozen=True)
class Hopper:
    r"""A torso with a motor at its hip, and a leg of spring, damper and thrust that ends in a foot.

    The hip is the torso's centre of mass, at (x, z) with z upwards; θ is its pitch, positive
    towards +x, and the foot, a point mass, is at :math:`(x + r\sin\alpha, z - r\cos\alpha)` with
    :math:`\alpha = \eta - \theta`, η the hip's angle from the torso and r the leg's length. With
    :math:`P_r = u - k(r - l) - c\dot r`, :math:`P_\alpha = \tau/r` and
    :math:`1/\mu = 1/m + 1/m_f`, under generalized forces F on the coordinates in their order, of
    which :math:`\tau = F_4` and :math:`u = F_5`,

    .. math::
        m\ddot x &= F_1 - P_r\sin\alpha - P_\alpha\cos\alpha \\
        m\ddot z &= F_2 + P_r\cos\alpha - P_\alpha\sin\alpha - m g \\
        J\ddot\theta &= F_3 + \tau \\
        \ddot r &= P_r/\mu - (F_1\sin\alpha - F_2\cos\alpha)/m + r\dot\alpha^2 \\
        r\ddot\alpha &= P_\alpha/\mu - (F_1\cos\alpha + F_2\sin\alpha)/m - 2\dot r\dot\alpha

    Only the foot touches the ground, which is z = 0. State (x, ẋ, z, ż, θ, θ̇, η, η̇, r, ṙ). The leg
    has no stops, and a length of 0 is a singularity, which a fall comes before. The mass matrix
    depends on α and r. Without control the torso falls over.
    Source of the machine, whose masses and lengths are of the order of these: Raibert (1986),
    *Legged Robots That Balance*, MIT Press, chapter 2.
    """

    mass: float = parameter(8.0, "kg", "mass of the torso", positive)
    inertia: float = parameter(1.0, "kg m^2", "of the torso in pitch, about the hip", positive)
    foot_mass: float = parameter(0.5, "kg", "mass of the foot", positive)
    leg_length: float = parameter(0.5, "m", "hip to foot where the spring is slack", positive)
    leg_stiffness: float = parameter(2000.0, "N/m", "of the leg's spring", nonnegative)
    damping: float = parameter(20.0, "N s/m", "along the leg", nonnegative)
    gravity: float = parameter(9.81, "m/s^2", "gravitational acceleration", nonnegative)
    ground_stiffness: float = parameter(20000.0, "N/m", "of the ground under the foot", positive)
    ground_damping: float = parameter(0.5, "s/m", "of the ground, see `press`", nonnegative)
    ground_friction: float = parameter(0.8, "1", "coefficient of friction", nonnegative)
    friction_speed: float = parameter(0.1, "m/s", "over which friction changes sign", positive)

    name: ClassVar[str] = "hopper"
    coordinates: ClassVar[tuple[str, ...]] = ("x", "z", "theta", "hip", "leg")
    velocities: ClassVar[tuple[str, ...]] = ("x_dot", "z_dot", "theta_dot", "hip_dot", "leg_dot")
    coordinate_units: ClassVar[tuple[str, ...]] = ("m", "m", "rad", "rad", "m")
    controls: ClassVar[tuple[tuple[str, str], ...]] = (("hip_torque", "N m"), ("leg_force", "N"))
    frame: ClassVar[str] = (
        "the ground; x to the right, z upwards, theta = 0 upright, positive towards +x, hip = 0 "
        "along the torso, positive with the foot towards +x"
    )
    actuated: ClassVar[tuple[int, ...]] = (3, 4)
    contact_names: ClassVar[tuple[str, ...]] = ("foot",)
    hands: ClassVar[tuple[tuple[float, ...], ...]] = ((1.0, 0.0), (0.0, 1.0))
    probe: ClassVar[tuple[float, ...]] = (0.7, 0.5, 2.5, 0.2, 0.4, -0.1, 1.1, -0.4, 0.9, -0.7)
    constant_mass_matrix: ClassVar[bool] = False

    @cached_property
    def mechanism(self) -> Mechanism:
        """Two slides and a hinge carry the torso, a hinge and a springy slide the foot."""
        links = (
            *floating_body(self.mass, self.inertia),
            Link("hip", "hinge", 0.0, 0.0, 0.0, 0.0, direction=(0, -1, 0)),
            Link(
                "leg", "slide", self.foot_mass, 0.0, 0.0, self.damping, direction=(0, 0, -1),
                stiffness=self.leg_stiffness, slack=self.leg_length,
            ),
        )  # fmt: skip
        return Mechanism(links, self.gravity)

    @cached_property
    def contacts(self) -> tuple[ContactPoint, ...]:
        """The foot on the ground."""
        return (
            ContactPoint(
                self.foot, self.ground_stiffness, self.ground_damping, self.ground_friction,
                self.friction_speed,
            ),
        )  # fmt: skip

    def foot(self, ops: Ops, q: Components) -> ContactFrame:
        """Height of the foot, m, and the rows that take velocities to its speeds up and along."""
        sine, cosine = ops.sin(q[3] - q[2]), ops.cos(q[3] - q[2])
        across, down = q[4] * sine, q[4] * cosine
        normal = (0.0, 1.0, 0.0 - across, across, 0.0 - cosine)
        return ContactFrame(q[1] - down, normal, (1.0, 0.0, 0.0 - down, down, sine))

    def acceleration(self, ops: Ops, q: Components, v: Components, force: Components) -> Components:
        """(ẍ, z̈, θ̈, η̈, r̈) in m/s^2 and rad/s^2."""
        sine, cosine = ops.sin(q[3] - q[2]), ops.cos(q[3] - q[2])
        swing, light = v[3] - v[2], 1.0 / self.mass
        pull = self.leg_stiffness * (q[4] - self.leg_length) + self.damping * v[4]
        push, shove = force[4] - pull, force[3] / q[4]
        both = light + 1.0 / self.foot_mass
        out = both * push - light * (force[0] * sine - force[1] * cosine) + q[4] * swing * swing
        round_ = both * shove - light * (force[0] * cosine + force[1] * sine) - 2.0 * v[4] * swing
        turn = (force[2] + force[3]) / self.inertia
        return (
            light * (force[0] - push * sine - shove * cosine),
            light * (force[1] + push * cosine - shove * sine) - self.gravity,
            turn,
            round_ / q[4] + turn,
            out,
        )

    def energy(self, ops: Ops, q: Components, v: Components) -> Component:
        """Kinetic energy, height over the ground's and tension of the leg, J."""
        height, (_, _, lift, raised, out), (_, _, turn, turned, along) = self.foot(ops, q)
        up = v[1] + lift * v[2] + raised * v[3] + out * v[4]
        across = v[0] + turn * v[2] + turned * v[3] + along * v[4]
        torso = self.mass * (v[0] * v[0] + v[1] * v[1]) + self.inertia * v[2] * v[2]
        weights = self.gravity * (self.mass * q[1] + self.foot_mass * height)
        stretch = q[4] - self.leg_length
        kinetic = 0.5 * (torso + self.foot_mass * (up * up + across * across))
        return kinetic + weights + 0.5 * self.leg_stiffness * stretch * stretch

    def dissipation(self, ops: Ops, q: Components, v: Components) -> Component:
        """Power taken out by the leg's damper, W, never negative."""
        return self.damping * v[4] * v[4]

    def mass_matrix(self, ops: Ops, q: Components) -> tuple[Components, ...]:
        """5×5 mass matrix; kg, kg m and kg m^2."""
        _, up, across = self.foot(ops, q)
        torso = (self.mass, self.mass, self.inertia, 0.0, 0.0)
        return tuple(
            tuple(
                self.foot_mass * (up[i] * up[j] + across[i] * across[j])
                + (torso[i] if i == j else 0.0)
                for j in range(5)
            )
            for i in range(5)
        )
