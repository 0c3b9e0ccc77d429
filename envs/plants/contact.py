"""Contact: the law of Hunt and Crossley, stops on a coordinate, and points that touch planes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from ..mechanics import Kink
from ..ops.ops import FLOAT32_MAX, Component, Components, Ops, along


class Press(NamedTuple):
    """What a compliant surface does to what presses into it; all zero where nothing does."""

    force: Component
    """Outwards, N or N m, never adhesive."""
    energy: Component
    """Elastic energy stored, J."""
    dissipated: Component
    """Power that it takes out, W, never negative."""


def press(
    ops: Ops, stiffness: Component, damping: Component, depth: Component, inward: Component
) -> Press:
    r"""The law of Hunt and Crossley for all that touches.

    With p the penetration and k, d the stiffness and damping, the force is

    .. math:: N = k\,p\,\max(0,\ 1 + d\,\dot p)

    which is continuous on touching and on leaving. Where nothing else acts on a mass, the speeds v
    of arrival and u of departure obey :math:`g(v) = g(-u)`, :math:`g(v) = v/d - \ln(1 + d v)/d^2`.
    Source: Hunt and Crossley (1975), *Coefficient of restitution interpreted as damping in
    vibroimpact*, Journal of Applied Mechanics 42, with exponent 1.

    Args:
        ops: arithmetic.
        stiffness: k, N/m or N m/rad.
        damping: d, s/m or s/rad.
        depth: p, m or rad, never negative.
        inward: its rate where it is positive, m/s or rad/s.
    """
    elastic = stiffness * depth
    push = elastic * _grip(ops, damping, inward)
    return Press(push, 0.5 * elastic * depth, (push - elastic) * inward)


def press_slopes(
    ops: Ops, stiffness: Component, damping: Component, depth: Component, inward: Component
) -> tuple[Component, Component]:
    """Of the force of :func:`press`, the slopes in the gap, which is -p, and in the gap's rate."""
    grip = _grip(ops, damping, inward)
    by_gap = ops.where(depth > 0.0, -stiffness * grip, 0.0)
    return by_gap, ops.where(grip > 0.0, -stiffness * damping * depth, 0.0)


def _grip(ops: Ops, damping: Component, inward: Component) -> Component:
    """max(0, 1 + d ṗ)."""
    return ops.maximum(1.0 + damping * inward, 0.0)


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
    """Stops at ±``limit`` on one coordinate, which push inwards as :func:`press`.

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
        side, depth, outward = self._touch(ops, q, v)
        push, energy, dissipated = press(ops, self.stiffness, self.damping, depth, outward)
        return Contact(0.0 - side * push, depth, energy, dissipated)

    def slopes(self, ops: Ops, q: Components, v: Components) -> tuple[Component, Component]:
        """(∂F/∂q, ∂F/∂v) of the generalized force, along the stopped coordinate."""
        _, depth, outward = self._touch(ops, q, v)
        return press_slopes(ops, self.stiffness, self.damping, depth, outward)

    def clearance(self, ops: Ops, q: Components, v: Components) -> tuple[Component, Component]:
        """Distance from the nearer stop, m or rad, negative in contact, and its rate."""
        x = q[self.coordinate]
        inward = ops.where(x < 0.0, v[self.coordinate], -v[self.coordinate])
        return self.limit - abs(x), inward

    def confine(self, ops: Ops, q: Components) -> Components:
        """``q`` with the stopped coordinate within its limits."""
        i = self.coordinate
        within = ops.maximum(-self.limit, ops.minimum(q[i], self.limit))
        return (*q[:i], within, *q[i + 1 :])

    def _touch(
        self, ops: Ops, q: Components, v: Components
    ) -> tuple[Component, Component, Component]:
        """Side (±1) of the nearer stop, penetration and speed outwards."""
        x = q[self.coordinate]
        side = ops.where(x < 0.0, -1.0, 1.0)
        depth = ops.maximum(side * x - self.limit, 0.0)
        return side, depth, side * v[self.coordinate]


def stops_at(
    coordinate: int, limit: Component | None, stiffness: Component, damping: Component
) -> Stops | None:
    """Stops on a coordinate, or None where there is no limit."""
    return None if limit is None else Stops(coordinate, limit, stiffness, damping)


class ContactFrame(NamedTuple):
    """Where a point of a plant is, seen from a plane that it may touch."""

    gap: Component
    """Distance from the plane, m, negative beyond it."""
    normal: Components
    """∂gap/∂q: along v, the rate of the gap, m/s; a force N on the point adds N times this."""
    tangent: Components
    """Along v, the slip: the speed of the point along the plane, m/s; likewise."""


class Touch(NamedTuple):
    """What is reported of a contact point."""

    penetration: Component = 0.0
    """m, never negative."""
    normal_force: Component = 0.0
    """N, never negative."""
    tangential_force: Component = 0.0
    """By friction on the point, along the plane, N."""
    slip_speed: Component = 0.0
    """Of the point along the plane, m/s; 0 where it does not touch."""
    stored_energy: Component = 0.0
    """Elastic energy stored in the plane, J."""
    contact_loss: Component = 0.0
    """What damping and friction took at the point in a control period, J."""
    slip_loss: Component = 0.0
    """What of it friction took, J."""


class Reaction(NamedTuple):
    """What a plane does to a plant at one point; all zero where they do not touch."""

    touch: Touch
    force: Components
    """Generalized."""
    damped: Component
    """Power that damping normal to the plane takes out, W, never negative."""
    rubbed: Component
    """Power that friction takes out, W, never negative."""


@dataclass(frozen=True)
class ContactPoint:
    r"""A point of a plant that may touch a plane: compliant, and with friction.

    The plane pushes with N as :func:`press`, and rubs by Coulomb's law, whose sign is smoothed over
    the speed :math:`v_s`:

    .. math:: T = -\mu N\,s / \sqrt{s^2 + v_s^2}

    with s the slip. A body that T holds creeps at :math:`v_s r / \sqrt{1 - r^2}`, with r its share
    of :math:`\mu N`. One that slides freely at :math:`v \gg v_s` comes to rest after
    :math:`v^2 / 2 \mu g` and :math:`v_s^2 (1/2 + \ln(2 v / v_s)) / 2 \mu g` more.
    A mass m on the plane swings at :math:`\sqrt{k/m}` and is braked at the rate
    :math:`\mu N / m v_s`: both bound the step. A rigid plane is another model.
    Not the tanh of :class:`~integ_gym.envs.mechanics.Friction`: it is of basic operations alone, so
    that compiled loops give the same bits.
    Source: Castro, Han and Masterjohn (2023), *A theory of irrotational contact fields*,
    arXiv:2312.03908: Hunt and Crossley's law with friction that is smoothed by a soft norm.

    Attributes:
        frame: of (ops, q): where the point is, with two rows of the plant's Jacobian.
        stiffness: k, N/m.
        damping: d, s/m.
        friction: coefficient μ.
        friction_speed: v_s, m/s.
    """

    frame: Callable[[Ops, Components], ContactFrame]
    stiffness: Component
    damping: Component
    friction: Component
    friction_speed: Component

    def reaction(self, ops: Ops, q: Components, v: Components) -> Reaction:
        """Forces, energy and powers in the state (q, v)."""
        gap, normal, tangent = self.frame(ops, q)
        depth, inward = _measure_penetration(ops, gap, normal, v)
        push, energy, damped = press(ops, self.stiffness, self.damping, depth, inward)
        slip = ops.where(depth > 0.0, _dot(tangent, v), 0.0)
        rub = 0.0 - self.friction * push * slip / self._smooth_slip(ops, slip)
        force = tuple([push * a + rub * b for a, b in zip(normal, tangent, strict=True)])
        touch = Touch(depth, push, rub, slip, energy)
        return Reaction(touch, force, damped, 0.0 - rub * slip)

    def slopes(
        self, ops: Ops, q: Components, v: Components
    ) -> tuple[tuple[Components, ...], tuple[Components, ...]]:
        """(∂F/∂q, ∂F/∂v) of the generalized force, each as its columns.

        The rows of the frame change with q by forward differences; the rest is written out.
        """
        gap, normal, tangent = self.frame(ops, q)
        depth, inward = _measure_penetration(ops, gap, normal, v)
        pressing = self.stiffness, self.damping, depth, inward
        push, by_gap, by_rate = press(ops, *pressing).force, *press_slopes(ops, *pressing)
        slip = _dot(tangent, v)
        smoothed = self._smooth_slip(ops, slip)
        share = 0.0 - self.friction * slip / smoothed
        layer = self.friction_speed / smoothed
        by_slip = 0.0 - self.friction * push * layer * layer / smoothed

        def column(by_push: Component, slipped: Component) -> Components:
            by_rub = share * by_push + by_slip * slipped
            return tuple([by_push * a + by_rub * b for a, b in zip(normal, tangent, strict=True)])

        by_q, increment = [], ops.epsilon**0.5
        for j, x in enumerate(q):
            moved = self.frame(ops, (*q[:j], x + increment, *q[j + 1 :]))
            turned = [
                tuple([(b - a) / increment for a, b in zip(row, other, strict=True)])
                for row, other in ((normal, moved.normal), (tangent, moved.tangent))
            ]
            by_push = by_gap * normal[j] + by_rate * _dot(turned[0], v)
            own = column(by_push, _dot(turned[1], v))
            by_q.append(
                tuple([f + push * (a + share * b) for f, a, b in zip(own, *turned, strict=True)])
            )
        pairs = zip(normal, tangent, strict=True)
        return tuple(by_q), tuple([column(by_rate * a, b) for a, b in pairs])

    def kinks(
        self, ops: Ops, q: Components, v: Components, acceleration: Components
    ) -> tuple[Kink, Kink, Kink]:
        """Of touching and leaving, of letting go while pressed in, and of sliding direction."""
        gap, normal, tangent = self.frame(ops, q)
        moment = ops.epsilon**0.5
        later = self.frame(ops, along(q, moment, v))
        rate, slip = _dot(normal, v), _dot(tangent, v)
        speeding = _dot(normal, acceleration) + (_dot(later.normal, v) - rate) / moment
        turning = _dot(tangent, acceleration) + (_dot(later.tangent, v) - slip) / moment
        return (
            Kink(gap, rate),
            Kink(
                1.0 - self.damping * rate,
                0.0 - self.damping * speeding,
                ops.where(gap < 0.0, 0.0, FLOAT32_MAX),
            ),
            Kink(slip, turning, ops.where(gap < 0.0, self.friction_speed, FLOAT32_MAX)),
        )

    def _smooth_slip(self, ops: Ops, slip: Component) -> Component:
        """|s|, but for about v_s around 0."""
        return ops.sqrt(slip * slip + self.friction_speed * self.friction_speed)


def _measure_penetration(
    ops: Ops, gap: Component, normal: Components, v: Components
) -> tuple[Component, Component]:
    """Penetration, and the speed inwards."""
    return ops.maximum(0.0 - gap, 0.0), 0.0 - _dot(normal, v)


def _dot(row: Components, v: Components) -> Component:
    """Of a row of a Jacobian and the velocity: the speed along it."""
    total = row[0] * v[0]
    for a, b in zip(row[1:], v[1:], strict=True):
        total = total + a * b
    return total
