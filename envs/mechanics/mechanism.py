"""A plant as a chain of rigid links: what a simulator of rigid bodies is told."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from ..arithmetic.ops import Component
from .contact import Stops


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
