"""How series are told apart: hues, markers and dashes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, TypeAlias

from .colours import PALETTE

HUES: Final = {
    "vermilion": ("#b84700", "#f2762e"),
    "blue": ("#004d85", "#2f86d6"),
    "green": ("#007a58", "#22b98c"),
    "purple": ("#b95b94", "#d984b8"),
    "orange": ("#c98a00", "#f5d24a"),
    "sky": ("#3399d4", "#9bdcff"),
    "ink": PALETTE["ink"],
}
"""Name to colours on light and on dark ground: those of Okabe and Ito, made as dark or as light as
the ground asks for, and apart for every kind of colour-blindness."""


def _star(count: int, turn: float, inner: float) -> tuple[tuple[float, float], ...]:
    """A star, first point at ``turn`` degrees, of the area 2; ``inner``: its smaller radius."""
    corners, between = 2 * count, math.pi / count
    outer = math.sqrt(2.0 / (count * inner * math.sin(between)))
    radii = [outer * (inner if k % 2 else 1.0) for k in range(corners)]
    angles = [math.radians(turn) + between * k for k in range(corners)]
    return tuple((r * math.cos(a), r * math.sin(a)) for r, a in zip(radii, angles, strict=True))


def _polygon(count: int, turn: float) -> tuple[tuple[float, float], ...]:
    """A regular polygon, first corner at ``turn`` degrees, of the area 2."""
    return _star(count, turn, math.cos(math.pi / count))[::2]


MARKERS: Final = {
    "circle": _polygon(24, 0.0),
    "square": _polygon(4, 45.0),
    "triangle": _polygon(3, 90.0),
    "diamond": _polygon(4, 90.0),
    "down": _polygon(3, -90.0),
    "star": _star(5, 90.0, 0.45),
    "cross": _star(4, 45.0, 0.4),
    "plus": _star(4, 90.0, 0.4),
    "left": _polygon(3, 180.0),
    "right": _polygon(3, 0.0),
}
"""Name to corners (x, y), y upwards."""

DASHES: Final = ((), (5.0, 2.0), (2.0, 1.5))
"""Lengths of strokes and gaps, in widths of the line; none: a whole line."""


@dataclass(frozen=True)
class SeriesStyle:
    """How one series of a plot is drawn.

    Attributes:
        hue: one of :data:`HUES`.
        marker: one of :data:`MARKERS`.
        dashes: one of :data:`DASHES`.
    """

    hue: str
    marker: str
    dashes: tuple[float, ...] = ()

    @property
    def colour(self) -> str:
        """On light ground, as ``#rrggbb``."""
        return HUES[self.hue][0]


SeriesStyles: TypeAlias = Mapping[str, SeriesStyle]
"""Style of every series that something shows, by its name."""
