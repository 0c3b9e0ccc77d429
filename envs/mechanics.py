"""What is said of plants beside their equations: kinks, dry friction, and links for engines."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from .ops.ops import Component, Components, Ops


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
    if all(isinstance(level, (int, float)) and level == 0 for level in levels):
        return None
    return Friction(levels, speed)


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

    def stopped(self, coordinate: int, limit: Component) -> Mechanism:
        """The same with stops on the joint of a coordinate, at ±``limit``."""
        links = list(self.links)
        links[coordinate] = replace(links[coordinate], limit=limit)
        return replace(self, links=tuple(links))
