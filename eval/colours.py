"""Colours that stand for numbers, the same on the page and in figures."""

from __future__ import annotations

import math
from typing import Final

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
    pair = (_channels(VIRIDIS[below]), _channels(VIRIDIS[below + 1]))
    share = place - below
    mixed = (round(one + share * (other - one)) for one, other in zip(*pair, strict=True))
    return "#" + "".join(f"{channel:02x}" for channel in mixed)


def ink_on(background: str) -> str:
    """Black or white, whichever reads better on a ``#rrggbb`` background (WCAG contrast)."""
    linear = [
        channel / 12.92 if channel <= 0.04045 else ((channel + 0.055) / 1.055) ** 2.4
        for channel in (value / 255.0 for value in _channels(background.lstrip("#")))
    ]
    luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
    return "#000000" if (luminance + 0.05) / 0.05 > 1.05 / (luminance + 0.05) else "#ffffff"


def _channels(colour: str) -> tuple[int, int, int]:
    return int(colour[:2], 16), int(colour[2:4], 16), int(colour[4:6], 16)


def symlog(value: float, floor: float, largest: float) -> float:
    """Share in [0, 1] of a size on a logarithmic scale that is linear below ``floor``."""
    if largest <= 0.0 or floor <= 0.0:
        return 0.0
    return math.asinh(value / floor) / math.asinh(largest / floor)
