"""Colours of pages and figures, and those that stand for numbers."""

from __future__ import annotations

import math
from typing import Final

PALETTE: Final = {
    "page": ("#f6f6f3", "#0d1015"),
    "card": ("#ffffff", "#161a21"),
    "sunk": ("#efefeb", "#1f242d"),
    "line": ("#dedfd9", "#2d343f"),
    "ink": ("#14171c", "#eceef2"),
    "soft": ("#565c66", "#a2a9b5"),
    "accent": ("#2f4fb5", "#9db4ff"),
    "fails": ("#b8400a", "#ff9966"),
    "transfers": ("#00724f", "#4fd0a5"),
    "inconclusive": ("#7a5a00", "#e6c15c"),
    "not_learned": ("#626873", "#a5acb8"),
    "warm": ("#e8783c", "#be541c"),
    "cool": ("#5492d6", "#2664aa"),
}
"""What a colour is for, to the colours on light and on dark ground."""

AMOUNTS: Final = {
    "start": ("accent", "accent"),
    "motor": ("soft", "soft"),
    "numerics": ("warm", "cool"),
    "losses": ("inconclusive", "inconclusive"),
    "energy": ("ink", "ink"),
}
"""Amount of energy to the names of its colours in :data:`PALETTE`, above and below zero, in the
order in which bars show them."""

VIRIDIS: Final = [
    "440154",
    "48186a",
    "472d7b",
    "424086",
    "3b528b",
    "33638d",
    "2c728e",
    "26828e",
    "21918c",
    "1fa088",
    "28ae80",
    "3fbc73",
    "5ec962",
    "84d44b",
    "addc30",
    "d8e219",
    "fde725",
]
"""Stops of the map for success, from 0 to 1: perceptually uniform, safe for the colour-blind."""

ENERGY_FLOOR: Final = 1e-4
"""Share of the largest energy residual below which its scale is linear."""


def success_colour(rate: float) -> str:
    """Colour of a success rate, as ``#rrggbb``."""
    place = min(max(rate, 0.0), 1.0) * (len(VIRIDIS) - 1)
    below = min(int(place), len(VIRIDIS) - 2)
    return mixed(f"#{VIRIDIS[below]}", f"#{VIRIDIS[below + 1]}", place - below)


def mixed(one: str, other: str, share: float) -> str:
    """The colour at a share in [0, 1] of the way between two ``#rrggbb`` colours."""
    pairs = zip(channels(one), channels(other), strict=True)
    return "#" + "".join(f"{round(a + share * (b - a)):02x}" for a, b in pairs)


def ink_on(background: str) -> str:
    """Black or white, whichever reads better on a ``#rrggbb`` background (WCAG contrast)."""
    linear = [
        channel / 12.92 if channel <= 0.04045 else ((channel + 0.055) / 1.055) ** 2.4
        for channel in (value / 255.0 for value in channels(background))
    ]
    luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
    return "#000000" if (luminance + 0.05) / 0.05 > 1.05 / (luminance + 0.05) else "#ffffff"


def channels(colour: str) -> tuple[int, int, int]:
    """Red, green and blue of a ``#rrggbb`` colour, 0 to 255."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def symlog(value: float, floor: float, largest: float) -> float:
    """Share in [0, 1] of a size on a logarithmic scale that is linear below ``floor``."""
    if largest <= 0.0 or floor <= 0.0:
        return 0.0
    return math.asinh(value / floor) / math.asinh(largest / floor)
