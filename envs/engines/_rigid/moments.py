"""Moments of inertia for simulators that take none of zero."""

from __future__ import annotations

from ...mechanics import Link

LEAST_SHARE = 1e-12
"""A point mass's moment of inertia about itself, as a share of that about its joint."""


def moment(link: Link) -> float:
    """A link's moment of inertia, kg m^2, or one above zero that makes no difference.

    A sliding body never turns: any will do.
    """
    about_joint = link.mass * (link.centre**2 or 1.0)
    least: float = max(link.inertia, LEAST_SHARE * about_joint)
    return least
