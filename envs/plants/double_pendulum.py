"""The planar double pendulum: the acrobot, driven at its second joint, and the reacher's arm."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from integ_gym.support.parameters import nonnegative, optional, parameter, positive

from ..mechanics import Link, Mechanism, Slopes
from ..ops.ops import Component, Components, Ops
from .interface import add_border


@dataclass(frozen=True)
class DoublePendulum:
    r"""Two rigid links in a vertical plane, the second angle relative to the first link.

    With :math:`c = m_2 l_1 c_2`, :math:`B = I_2 + m_2 c_2^2`,
    :math:`A = I_1 + m_1 c_1^2 + m_2 l_1^2 + B` and the centres of mass at :math:`c_1, c_2` from the
    joints:

    .. math::
        (A + 2c\cos\theta_2)\,\ddot\theta_1 + (B + c\cos\theta_2)\,\ddot\theta_2 &= \tau_1
        - b\dot\theta_1 + c\sin\theta_2\,\dot\theta_2 (2\dot\theta_1 + \dot\theta_2)
        - (m_1 c_1 + m_2 l_1) g\sin\theta_1 - m_2 c_2 g\sin(\theta_1 + \theta_2) \\
        (B + c\cos\theta_2)\,\ddot\theta_1 + B\,\ddot\theta_2 &= \tau_2 - b\dot\theta_2
        - c\sin\theta_2\,\dot\theta_1^2 - m_2 c_2 g\sin(\theta_1 + \theta_2)

    State (θ₁, θ̇₁, θ₂, θ̇₂). The mass matrix depends on θ₂, so (q, v) maps of symplectic integrators
    are not symplectic here.
    Source: Spong (1995), *The swing up control problem for the acrobot*, IEEE Control Systems 15,
    equations 1 and 2, with the first angle from hanging.
    """

    mass_1: float = parameter(1.0, "kg", "mass of the first link", positive)
    mass_2: float = parameter(1.0, "kg", "mass of the second link", positive)
    length_1: float = parameter(1.0, "m", "first joint to second joint", positive)
    length_2: float = parameter(1.0, "m", "second joint to the tip", positive)
    centre_1: float = parameter(
        0.5, "m", "first joint to the first link's centre of mass", positive
    )
    centre_2: float = parameter(
        0.5, "m", "second joint to the second link's centre of mass", positive
    )
    inertia_1: float = parameter(
        1.0, "kg m^2", "of the first link about its centre of mass", positive
    )
    inertia_2: float = parameter(
        1.0, "kg m^2", "of the second link about its centre of mass", positive
    )
    gravity: float = parameter(9.8, "m/s^2", "gravitational acceleration", nonnegative)
    damping: float = parameter(0.0, "N m s/rad", "viscous damping at either joint", nonnegative)
    max_speed_1: float | None = parameter(
        None, "rad/s", "clip on the first joint's speed; `None`: no clip", optional(positive)
    )
    max_speed_2: float | None = parameter(
        None, "rad/s", "clip on the second joint's speed; `None`: no clip", optional(positive)
    )

    coordinates: ClassVar[tuple[str, ...]] = ("theta_1", "theta_2")
    velocities: ClassVar[tuple[str, ...]] = ("theta_1_dot", "theta_2_dot")
    coordinate_units: ClassVar[tuple[str, ...]] = ("rad", "rad")
    frame: ClassVar[str] = (
        "first joint; theta_1 = 0 hanging, theta_2 = 0 straight, both positive counter-clockwise"
    )
    constant_mass_matrix: ClassVar[bool] = False

    @cached_property
    def mechanism(self) -> Mechanism:
        """Both links, which hang at zero: their own z axes point upwards there."""
        first = Link(
            "theta_1", "hinge", self.mass_1, -self.centre_1, self.inertia_1, self.damping,
            length=-self.length_1,
        )  # fmt: skip
        second = Link(
            "theta_2", "hinge", self.mass_2, -self.centre_2, self.inertia_2, self.damping,
            length=-self.length_2,
        )  # fmt: skip
        return Mechanism((first, second), self.gravity)

    @cached_property
    def speed_limits(self) -> tuple[Component | None, ...] | None:
        """Of both joints, rad/s, None where a joint has none; None where neither has one."""
        limits = self.max_speed_1, self.max_speed_2
        return None if all(limit is None for limit in limits) else limits

    @cached_property
    def coupling(self) -> Component:
        """c, kg m^2: what the second angle changes in the mass matrix."""
        return self.mass_2 * self.length_1 * self.centre_2

    @cached_property
    def outer_inertia(self) -> Component:
        """B, kg m^2: of the second link about its joint."""
        return self.inertia_2 + self.mass_2 * self.centre_2 * self.centre_2

    @cached_property
    def inner_inertia(self) -> Component:
        """A, kg m^2: both links about the first joint, less what depends on the second angle."""
        first = self.inertia_1 + self.mass_1 * self.centre_1 * self.centre_1
        return first + self.mass_2 * self.length_1 * self.length_1 + self.outer_inertia

    @cached_property
    def inner_weight(self) -> Component:
        """(m₁ c₁ + m₂ l₁) g, N m."""
        return (self.mass_1 * self.centre_1 + self.mass_2 * self.length_1) * self.gravity

    @cached_property
    def outer_weight(self) -> Component:
        """m₂ c₂ g, N m."""
        return self.mass_2 * self.centre_2 * self.gravity

    def acceleration(self, ops: Ops, q: Components, v: Components, force: Components) -> Components:
        """(θ̈₁, θ̈₂), rad/s^2."""
        bend = self.coupling * ops.sin(q[1])
        outer = self.outer_weight * ops.sin(q[0] + q[1])
        first = force[0] - self.damping * v[0] + bend * v[1] * (2.0 * v[0] + v[1])
        first = first - self.inner_weight * ops.sin(q[0]) - outer
        second = force[1] - self.damping * v[1] - bend * v[0] * v[0] - outer
        return self._solve(ops, q, first, second)

    def jacobian(self, ops: Ops, q: Components, v: Components, force: Components) -> Slopes:
        """(∂a/∂q, ∂a/∂v), each a 2×2 nested tuple."""
        a = self.acceleration(ops, q, v, force)
        bend, slope = self.coupling * ops.sin(q[1]), self.coupling * ops.cos(q[1])
        outer = self.outer_weight * ops.cos(q[0] + q[1])
        columns = (
            (-self.inner_weight * ops.cos(q[0]) - outer, -outer),
            (
                slope * v[1] * (2.0 * v[0] + v[1]) - outer + bend * (2.0 * a[0] + a[1]),
                bend * a[0] - slope * v[0] * v[0] - outer,
            ),
            (2.0 * bend * v[1] - self.damping, -2.0 * bend * v[0]),
            (2.0 * bend * (v[0] + v[1]), -self.damping + 0.0 * bend),
        )
        t1, t2, w1, w2 = (self._solve(ops, q, *column) for column in columns)
        return ((t1[0], t2[0]), (t1[1], t2[1])), ((w1[0], w2[0]), (w1[1], w2[1]))

    def energy(self, ops: Ops, q: Components, v: Components) -> Component:
        """Kinetic plus potential energy, J; zero at rest hanging."""
        a, b, d = self._masses(ops, q)
        kinetic = 0.5 * (a * v[0] * v[0] + d * v[1] * v[1]) + b * v[0] * v[1]
        height = self.inner_weight * (1.0 - ops.cos(q[0]))
        return kinetic + height + self.outer_weight * (1.0 - ops.cos(q[0] + q[1]))

    def dissipation(self, ops: Ops, q: Components, v: Components) -> Component:
        """Power taken out by both dampers, W, never negative."""
        return self.damping * (v[0] * v[0] + v[1] * v[1])

    def mass_matrix(self, ops: Ops, q: Components) -> tuple[Components, ...]:
        """2×2 mass matrix, kg m^2."""
        a, b, d = self._masses(ops, q)
        return (a, b), (b, d)

    def _masses(self, ops: Ops, q: Components) -> Components:
        """Of the first joint, of both together and of the second, kg m^2."""
        bent = self.coupling * ops.cos(q[1])
        return self.inner_inertia + 2.0 * bent, self.outer_inertia + bent, self.outer_inertia

    def _solve(self, ops: Ops, q: Components, first: Component, second: Component) -> Components:
        """Accelerations under these generalized forces."""
        a, b, d = self._masses(ops, q)
        inverse = 1.0 / (a * d - b * b)
        return (d * first - b * second) * inverse, (a * second - b * first) * inverse


@dataclass(frozen=True)
class Acrobot(DoublePendulum):
    """The double pendulum with a motor at its second joint alone; Gymnasium's is the default.

    Control: torque τ₂ between the links. ``Acrobot-v1`` has the equations of Sutton and Barto's
    book, which are those of :class:`DoublePendulum`.
    """

    name: ClassVar[str] = "acrobot"
    controls: ClassVar[tuple[tuple[str, str], ...]] = (("torque", "N m"),)
    actuated: ClassVar[tuple[int, ...]] = (1,)


@dataclass(frozen=True)
class ReachingArm(DoublePendulum):
    r"""The double pendulum with a motor at either joint, and the clock of a marker to follow.

    By default without gravity. Controls: torques τ₁ from the ground and τ₂ between the links. The
    marker's phase :math:`\phi` is a coordinate that nothing acts on, :math:`\ddot\phi = 0`: it
    has no mass, no energy and no part in the work, and every integrator has it exact. Where the
    marker is at a phase the task says. State (θ₁, θ̇₁, θ₂, θ̇₂, φ, φ̇).
    """

    gravity: float = parameter(0.0, "m/s^2", "gravitational acceleration", nonnegative)

    name: ClassVar[str] = "reacher"
    coordinates: ClassVar[tuple[str, ...]] = ("theta_1", "theta_2", "marker_phase")
    velocities: ClassVar[tuple[str, ...]] = ("theta_1_dot", "theta_2_dot", "marker_rate")
    coordinate_units: ClassVar[tuple[str, ...]] = ("rad", "rad", "rad")
    controls: ClassVar[tuple[tuple[str, str], ...]] = (("torque_1", "N m"), ("torque_2", "N m"))
    actuated: ClassVar[tuple[int, ...]] = (0, 1)
    massless: ClassVar[tuple[int, ...]] = (2,)

    def acceleration(self, ops: Ops, q: Components, v: Components, force: Components) -> Components:
        """(θ̈₁, θ̈₂, φ̈), rad/s^2."""
        return *super().acceleration(ops, q, v, force), force[2]

    def jacobian(self, ops: Ops, q: Components, v: Components, force: Components) -> Slopes:
        """(∂a/∂q, ∂a/∂v), each a 3×3 nested tuple."""
        by_q, by_v = super().jacobian(ops, q, v, force)
        return add_border(by_q, 0.0 * q[2]), add_border(by_v, 0.0 * q[2])

    def mass_matrix(self, ops: Ops, q: Components) -> tuple[Components, ...]:
        """3×3 mass matrix, kg m^2; 0 of the clock."""
        return add_border(super().mass_matrix(ops, q), 0.0 * q[2])
