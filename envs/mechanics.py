"""The plant as integrators see it: equations of motion with stops, friction and a speed limit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from .ops.ops import Component, Components, Ops


class Contact(NamedTuple):
    """What the stops do to a plant in one state; all zero away from them."""

    force: Component
    """Generalized force along the stopped coordinate, N or N m: inwards, never adhesive."""
    penetration: Component
    """How far the coordinate is beyond its limit, m or rad."""
    energy: Component
    """Elastic energy stored in the stop, J."""
    dissipated: Component
    """Power that the stop takes out, W, never negative."""


@dataclass(frozen=True)
class Stops:
    r"""Stops at ±``limit`` on one coordinate.

    With p the penetration and k, d the stiffness and damping, the stop pushes inwards with

    .. math:: F = k\,p\,\max(0,\ 1 + d\,\dot p)

    which is continuous on touching and on leaving. Where nothing else acts on a mass, the speeds v
    of arrival and u of departure obey :math:`g(v) = g(-u)`, :math:`g(v) = v/d - \ln(1 + d v)/d^2`.
    Source: Hunt and Crossley (1975), *Coefficient of restitution interpreted as damping in
    vibroimpact*, Journal of Applied Mechanics 42, with exponent 1.

    Attributes:
        coordinate: index of the stopped coordinate.
        limit: distance of either stop from zero, m or rad.
        stiffness: k, N/m or N m/rad.
        damping: d, s/m or s/rad.
    """

    coordinate: int
    limit: Component
    stiffness: Component
    damping: Component

    def contact(self, ops: Ops, q: Components, v: Components) -> Contact:
        """Force, penetration, energy and dissipated power in the state (q, v)."""
        side, depth, outward, grip = self._touch(ops, q, v)
        elastic = self.stiffness * depth
        push = elastic * grip
        return Contact(0.0 - side * push, depth, 0.5 * elastic * depth, (push - elastic) * outward)

    def slopes(self, ops: Ops, q: Components, v: Components) -> tuple[Component, Component]:
        """(∂F/∂q, ∂F/∂v) of the generalized force, along the stopped coordinate."""
        _, depth, _, grip = self._touch(ops, q, v)
        by_q = ops.where(depth > 0.0, -self.stiffness * grip, 0.0)
        by_v = ops.where(grip > 0.0, -self.stiffness * self.damping * depth, 0.0)
        return by_q, by_v

    def clearance(self, ops: Ops, q: Components, v: Components) -> tuple[Component, Component]:
        """Distance from the nearer stop, m or rad, negative in contact, and its rate."""
        x = q[self.coordinate]
        inward = ops.where(x < 0.0, v[self.coordinate], -v[self.coordinate])
        return self.limit - abs(x), inward

    def confined(self, ops: Ops, q: Components) -> Components:
        """``q`` with the stopped coordinate within its limits."""
        i = self.coordinate
        within = ops.maximum(-self.limit, ops.minimum(q[i], self.limit))
        return (*q[:i], within, *q[i + 1 :])

    def _touch(
        self, ops: Ops, q: Components, v: Components
    ) -> tuple[Component, Component, Component, Component]:
        """Side (±1) of the nearer stop, penetration, speed outwards and max(0, 1 + d ṗ)."""
        x = q[self.coordinate]
        side = ops.where(x < 0.0, -1.0, 1.0)
        outward = side * v[self.coordinate]
        depth = ops.maximum(side * x - self.limit, 0.0)
        return side, depth, outward, ops.maximum(1.0 + self.damping * outward, 0.0)


def stops_at(
    coordinate: int, limit: Component | None, stiffness: Component, damping: Component
) -> Stops | None:
    """Stops on a coordinate, or None where there is no limit."""
    return None if limit is None else Stops(coordinate, limit, stiffness, damping)


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
    if all(isinstance(level, (int, float)) and level == 0 for level in levels):
        return None
    return Friction(levels, speed)


WHEN = ("continuous", "step", "period")
"""Where a servo takes its measurements; see :class:`Servo`."""


@dataclass(frozen=True)
class Servo:
    r"""A proportional-derivative servo on every driven coordinate, with a limit of its effort.

    .. math:: \tau = \mathrm{sat}(k_p (q^* - q) - k_d \dot q)

    Simulators mix up three things by this name. ``continuous``: a force within the vector field,
    which integrators see in all their stages, implicit ones with its derivative (MuJoCo's position
    actuators under its implicit integrators, PyBullet's and PhysX's drives are approximations of
    it). ``step``: computed at the start of every integration step and held in it, so that the servo
    changes with ``dt`` (MuJoCo's Euler, and most training code with a decimation). ``period``:
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


@dataclass(frozen=True)
class Link:
    """A rigid body moved by one joint, planar in x (to the right) and z (upwards).

    Attributes:
        coordinate: name of the joint's coordinate.
        joint: ``"slide"`` along +x, or ``"hinge"`` about +y, which turns +z towards +x.
        mass: kg.
        centre: from the joint to the centre of mass along the link's own z axis, m.
        inertia: about the centre of mass and y, kg m^2; 0 for a point mass.
        damping: viscous, at the joint, N s/m or N m s/rad.
        limit: where the joint has stops by an engine's own law, m or rad to either side; or None.
    """

    coordinate: str
    joint: Literal["slide", "hinge"]
    mass: Component
    centre: Component
    inertia: Component
    damping: Component
    limit: Component | None = None


@dataclass(frozen=True)
class Mechanism:
    """Links from the ground up, each hung on the joint of the one before; the first on the ground.

    Joint coordinates are the plant's, in its order: a hinge at 0 has its link upright.

    Attributes:
        links: in the order of the plant's coordinates.
        gravity: gravitational acceleration along -z, m/s^2.
    """

    links: tuple[Link, ...]
    gravity: Component

    def stopped(self, stops: Stops | None) -> Mechanism:
        """The same with stops on the joint whose coordinate they stop."""
        if stops is None:
            return self
        links = list(self.links)
        links[stops.coordinate] = replace(links[stops.coordinate], limit=stops.limit)
        return replace(self, links=tuple(links))
