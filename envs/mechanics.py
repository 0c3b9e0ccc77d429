"""What is said of plants beside their equations: kinks, dry friction, and links for engines."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from .ops.ops import Component, Components, Ops

Rates = tuple[Components, Components]
"""Accelerations, and the power of each loss component, W."""

Slopes = tuple[tuple[Components, ...], tuple[Components, ...]]
"""(∂a/∂q, ∂a/∂v) by rows."""


class Kink(NamedTuple):
    """What may change its sign within a step, and the accelerations their slope with it."""

    value: Component
    rate: Component
    """Of the value, per second."""
    layer: Component | None = None
    """The accelerations are smooth over so much of the value; None: over nothing of it."""


@dataclass(frozen=True)
class Friction:
    r"""Coulomb friction on every coordinate: :math:`F_i = -c_i \tanh(v_i / v_s)`.

    The sign of the velocity is smoothed over the speed :math:`v_s`, so that the force is analytic;
    a body held by friction creeps at less than that speed instead of sticking.
    Source: Andersson, Söderberg and Björklund (2007), *Friction models for sliding dry, boundary
    and mixed lubricated contacts*, Tribology International 40, equation 3.

    Attributes:
        levels: c of each coordinate, N or N m.
        speed: v_s, m/s or rad/s.
    """

    levels: Components
    speed: Component

    def forces(self, ops: Ops, v: Components) -> Components:
        """Generalized friction force on each coordinate, N or N m."""
        return tuple(
            [-level * ops.tanh(x / self.speed) for level, x in zip(self.levels, v, strict=True)]
        )

    def slopes(self, ops: Ops, v: Components) -> Components:
        """∂F_i/∂v_i of each coordinate."""
        slopes = []
        for level, x in zip(self.levels, v, strict=True):
            tangent = ops.tanh(x / self.speed)
            slopes.append(-level / self.speed * (1.0 - tangent * tangent))
        return tuple(slopes)


def friction_of(levels: Components, speed: Component) -> Friction | None:
    """The friction of these levels, or None where all of them are the number zero."""
    return None if all(map(_is_zero, levels)) else Friction(levels, speed)


def _is_zero(x: Component) -> bool:
    """Whether it is the number zero."""
    return isinstance(x, (int, float)) and x == 0


WHEN = ("continuous", "step", "period")
"""Where a servo takes its measurements; see :class:`Servo`."""


@dataclass(frozen=True)
class Servo:
    r"""A proportional-derivative servo on every driven coordinate, with a limit of its effort.

    .. math:: \tau = \mathrm{sat}(k_p (q^* - q) - k_d \dot q)

    Simulators mix up three things by this name. ``continuous``: a force within the vector field,
    which integrators see in all their stages, implicit ones with its derivative (MuJoCo's position
    actuators, PhysX's drives). ``step``: computed at the start of every integration step and held
    in it, so that the servo changes with ``dt`` (Isaac Lab's explicit actuators). ``period``:
    computed every ``period`` seconds and held, as by a digital controller.
    The sampled servo on a mass m is stable for :math:`k_d h / m < 2` where :math:`k_p = 0`.
    Source: Åström and Wittenmark, *Computer-Controlled Systems*, 3rd ed., sections 2.3 and 3.3.

    Attributes:
        places: of the driven coordinates.
        stiffness: k_p, N m/rad or N/m.
        damping: k_d, N m s/rad or N s/m.
        limits: smallest and largest effort on each, N m or N.
        when: one of `WHEN`.
        period: s; of ``period`` alone.
    """

    places: tuple[int, ...]
    stiffness: Component
    damping: Component
    limits: tuple[tuple[Component, Component], ...]
    when: str
    period: float | None

    def efforts(self, ops: Ops, q: Components, v: Components, targets: Components) -> Components:
        """Of each control, N m or N, within its limits."""
        efforts = []
        for target, place, (low, high) in zip(targets, self.places, self.limits, strict=True):
            wanted = self.stiffness * (target - q[place]) - self.damping * v[place]
            efforts.append(ops.maximum(low, ops.minimum(wanted, high)))
        return tuple(efforts)

    def slopes(
        self, ops: Ops, q: Components, v: Components, targets: Components
    ) -> list[tuple[int, Component, Component]]:
        """(place, ∂τ/∂q, ∂τ/∂q̇) of each control, zero where its effort is at a limit."""
        slopes = []
        efforts = self.efforts(ops, q, v, targets)
        for effort, place, (low, high) in zip(efforts, self.places, self.limits, strict=True):
            free = (effort > low) & (effort < high)
            by_q = ops.where(free, -self.stiffness, 0.0)
            slopes.append((place, by_q, ops.where(free, -self.damping, 0.0)))
        return slopes

    def steps(self, ops: Ops, dt: Component) -> Component:
        """Integration steps between two measurements."""
        return 1 if self.period is None else ops.floor(self.period / dt + 0.5)


Direction = tuple[int, int, int]
"""A unit vector along an axis or against it."""

LEAST_SHARE = 1e-12
"""Of a mechanism's mass or moment of inertia: a part that makes no difference."""


@dataclass(frozen=True)
class Link:
    """A rigid body moved by one joint, planar in x (to the right) and z (upwards).

    Attributes:
        coordinate: name of the joint's coordinate.
        joint: ``"slide"`` or ``"hinge"``.
        mass: kg; 0 of a link that only joins two others.
        centre: from the joint to the centre of mass along the link's own z axis, m; below zero of
            a link that hangs where its coordinate is 0.
        inertia: about the centre of mass and y, kg m^2; 0 for a point mass.
        damping: viscous, at the joint, N s/m or N m s/rad.
        limit: where the joint has stops by an engine's own law, m or rad to either side; or None.
        length: from the joint to the next along the link's own z axis, or to its end, m.
        direction: of the joint's axis; None: a slide goes along +x, and a hinge is about +y, which
            turns +z towards +x.
        stiffness: of a spring at the joint, N/m or N m/rad.
        slack: coordinate at which the spring pulls nowhere, m or rad.
    """

    coordinate: str
    joint: Literal["slide", "hinge"]
    mass: Component
    centre: Component
    inertia: Component
    damping: Component
    limit: Component | None = None
    length: Component = 0.0
    direction: Direction | None = None
    stiffness: Component = 0.0
    slack: Component = 0.0

    @property
    def axis(self) -> Direction:
        """Of the joint, in the frame of the link before."""
        return self.direction or ((1, 0, 0) if self.joint == "slide" else (0, 1, 0))


def floating_body(
    mass: Component, inertia: Component, damping: Component = 0.0
) -> tuple[Link, Link, Link]:
    """A body that moves freely in the plane: slides along x and z, and a hinge in its middle."""
    return (
        Link("x", "slide", 0.0, 0.0, 0.0, damping),
        Link("z", "slide", 0.0, 0.0, 0.0, damping, direction=(0, 0, 1)),
        Link("theta", "hinge", mass, 0.0, inertia, 0.0),
    )


@dataclass(frozen=True)
class Mechanism:
    """Links from the ground up, each hung on the joint of the one before; the first on the ground.

    Joint coordinates are the plant's, in its order, without those that have no mass, which are its
    last: where all hinges are at 0, all z axes point up.

    Attributes:
        links: in the order of the plant's coordinates.
        gravity: gravitational acceleration along -z, m/s^2.
    """

    links: tuple[Link, ...]
    gravity: Component

    @property
    def offsets(self) -> Components:
        """Where each joint is on the link before, or on the ground, along its z axis, m."""
        return (0.0, *[link.length for link in self.links[:-1]])

    def stopped(self, coordinate: int, limit: Component) -> Mechanism:
        """The same with stops on the joint of a coordinate, at ±``limit``."""
        links = list(self.links)
        links[coordinate] = replace(links[coordinate], limit=limit)
        return replace(self, links=tuple(links))

    @property
    def solid(self) -> Mechanism:
        """The same where each link has a mass: simulators take no body without one."""
        least = LEAST_SHARE * sum(link.mass for link in self.links)
        heavy = [replace(x, mass=least) if _is_zero(x.mass) else x for x in self.links]
        return replace(self, links=tuple(heavy))

    @property
    def sprung(self) -> bool:
        """Whether a joint has a spring."""
        return not all(_is_zero(link.stiffness) for link in self.links)

    @property
    def without_springs(self) -> Mechanism:
        """The same without springs."""
        return replace(self, links=tuple([replace(link, stiffness=0.0) for link in self.links]))

    def spring_forces(self, q: Components) -> Components:
        """Generalized force of the springs, N or N m."""
        pairs = zip(self.links, q[: len(self.links)], strict=True)
        return tuple([0.0 - link.stiffness * (x - link.slack) for link, x in pairs])
