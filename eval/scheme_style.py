"""Colours and markers of integrators, by name: the same on pages and in every figure."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from itertools import product
from typing import Final

from integ_gym.support.figures import DASHES, HUES, MARKERS, SeriesStyle, SeriesStyles

NATIVE: Final[SeriesStyles] = {
    "explicit_euler": SeriesStyle("vermilion", "circle"),
    "symplectic_euler": SeriesStyle("blue", "square"),
    "stormer_verlet": SeriesStyle("purple", "triangle"),
    "rk4": SeriesStyle("green", "diamond"),
    "implicit_euler": SeriesStyle("orange", "down"),
    "implicit_midpoint": SeriesStyle("sky", "star"),
    "reference": SeriesStyle("ink", "cross"),
}
"""Styles of our own integrators."""

OTHERS: Final = tuple(
    SeriesStyle(hue, marker, dashes)
    for dashes, marker, hue in product(DASHES[1:], MARKERS, HUES)
    if hue != "ink"
)
"""Styles of integrators of engines and users."""


def styles_of(names: Iterable[str]) -> dict[str, SeriesStyle]:
    """Styles of integrators that are shown together, no two alike.

    Ours have always the same, and so has any other name, unless it shares one with another name
    here; then the later in the alphabet takes the next.
    """
    wanted = list(dict.fromkeys(names))
    found: dict[str, SeriesStyle] = {}
    for name in sorted(name for name in wanted if name not in NATIVE):
        first = zlib.crc32(name.encode())
        free = (OTHERS[(first + k) % len(OTHERS)] for k in range(len(OTHERS)))
        found[name] = next(style for style in free if style not in found.values())
    return {name: NATIVE[name] if name in NATIVE else found[name] for name in wanted}
