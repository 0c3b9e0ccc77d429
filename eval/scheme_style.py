"""Colours and markers of integrators, by name: the same on pages and in every figure."""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Final, TypeAlias

from integ_gym.support import PALETTE

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
class SchemeStyle:
    """How an integrator is drawn.

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


Schemes: TypeAlias = Mapping[str, SchemeStyle]
"""Style of every integrator that something shows, by name."""

NATIVE: Final[Schemes] = {
    "explicit_euler": SchemeStyle("vermilion", "circle"),
    "symplectic_euler": SchemeStyle("blue", "square"),
    "stormer_verlet": SchemeStyle("purple", "triangle"),
    "rk4": SchemeStyle("green", "diamond"),
    "implicit_euler": SchemeStyle("orange", "down"),
    "implicit_midpoint": SchemeStyle("sky", "star"),
    "reference": SchemeStyle("ink", "cross"),
}
"""Styles of our own integrators."""

OTHERS: Final = tuple(
    SchemeStyle(hue, marker, dashes)
    for dashes, marker, hue in product(DASHES[1:], MARKERS, HUES)
    if hue != "ink"
)
"""Styles of integrators of engines and users."""


def styles_of(names: Iterable[str]) -> dict[str, SchemeStyle]:
    """Styles of integrators that are shown together, no two alike.

    Ours have always the same, and so has any other name, unless it shares one with another name
    here; then the later in the alphabet takes the next.
    """
    wanted = list(dict.fromkeys(names))
    found: dict[str, SchemeStyle] = {}
    for name in sorted(name for name in wanted if name not in NATIVE):
        first = zlib.crc32(name.encode())
        free = (OTHERS[(first + k) % len(OTHERS)] for k in range(len(OTHERS)))
        found[name] = next(style for style in free if style not in found.values())
    return {name: NATIVE[name] if name in NATIVE else found[name] for name in wanted}
