"""Amounts of energy as bars."""

from __future__ import annotations

import math
from collections.abc import Mapping

from integ_gym.support.figures.colours import AMOUNTS, PALETTE, channels
from integ_gym.support.terminal.formatting import fixed

from .canvas import FAINT, INK, MUTED, Canvas, Colour, tint

BAR = 24
"""Height of a bar with the room around it, pixels."""
_NAME, _VALUE, _EDGE = 74.0, 68.0, 14.0


def draw_bars(
    canvas: Canvas, top: float, amounts: Mapping[str, float], reach: tuple[float, float]
) -> None:
    """Draw amounts below one another, over the whole width.

    Args:
        canvas: what is drawn on.
        top: of the first bar.
        amounts: name to value, J; NaN where it is not known.
        reach: value at the left and at the right end, J, the first not above 0.
    """
    for row, (name, value) in enumerate(amounts.items()):
        _bar(canvas, top + (row + 0.5) * BAR, name, value, reach)


def colour_of(amount: str, value: float = 0.0) -> Colour:
    """Colour of an amount of energy, by its name."""
    above, below = AMOUNTS[amount]
    return channels(PALETTE[above if value >= 0.0 else below][0])


def _bar(canvas: Canvas, y: float, name: str, value: float, reach: tuple[float, float]) -> None:
    (low, high), end = reach, canvas.size[0] - _EDGE
    left, right = _EDGE + _NAME, end - _VALUE
    scale = (right - left) / (high - low)
    zero = left - scale * low
    canvas.text(name, (_EDGE, y), 20, MUTED)
    canvas.box(((left + right) / 2, y), (right - left, 12.0), 3.0, tint(FAINT, 0.7))
    known = math.isfinite(value)
    if known:
        tip = zero + scale * max(low, min(high, value))
        canvas.box(((zero + tip) / 2, y), (abs(tip - zero), 12.0), 0.0, colour_of(name, value))
    canvas.line((zero, y - 8.0), (zero, y + 8.0), 1.5, INK, rounded=False)
    said = f"{fixed(value, 1, name == 'numerics')} J" if known else "not known"
    canvas.text(said, (end, y), 20, INK if known else MUTED, align=1.0)
