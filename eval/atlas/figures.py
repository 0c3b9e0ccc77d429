"""The phase diagram of an atlas."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from integ_gym.support.figures import (
    INK,
    PAPER,
    SOFT,
    SUNK,
    blank_figure,
    draw_heading,
    inch_canvas,
    ink_on,
    success_colour,
)
from integ_gym.support.terminal import NONE, fixed

from .summaries import Point

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDE, HIGH = 0.5, 0.27  # inches of a cell
_LEFT, _TOP, _GAP = 2.8, 1.35, 0.5
_NARROWEST = 9.2
"""Figure that its heading fits, in."""


def draw_phases(
    name: str, found: Sequence[Point], homes: Sequence[str], ratios: Sequence[float]
) -> Figure:
    """Success at home and on the truth, by training ground and limit of the control.

    Args:
        name: of the atlas.
        found: its points; what is not among them is drawn as an empty cell.
        homes: rows from top to bottom.
        ratios: columns from left to right.
    """
    across = WIDE * len(ratios)
    width = max(_LEFT + 2 * across + _GAP + 0.3, _NARROWEST)
    figure = blank_figure(width, _TOP + HIGH * len(homes) + 0.55)
    axes = inch_canvas(figure)
    draw_heading(
        axes, 0.3, f"{name}: where a policy learns, and what it keeps",
        "mean success of policies by what they were trained on (rows) and the limit of the control "
        "over the least that the truth takes (columns)",
    )  # fmt: skip
    by_place = {(point.home.name, point.ratio): point for point in found}
    for side, title in enumerate(("at home", "on the truth")):
        left = _LEFT + side * (across + _GAP)
        axes.text(left, _TOP - 0.32, title, size=10, weight="bold", color=INK)
        for k, ratio in enumerate(ratios):
            x = left + WIDE * (k + 0.5)
            axes.text(x, _TOP - 0.1, f"{ratio:g}", size=8, color=SOFT, ha="center")
            for row, home in enumerate(homes):
                point = by_place.get((home, ratio))
                rates = None if point is None else (point.at_home, point.on_truth)[side]
                _draw_cell(axes, left + WIDE * k, _TOP + HIGH * row, rates)
    for row, home in enumerate(homes):
        y = _TOP + HIGH * (row + 0.5)
        own = home.rpartition(":")[2]  # of a map of one's own, "module:Class"
        axes.text(_LEFT - 0.12, y, own, size=8, color=INK, ha="right", va="center")
    return figure


def _draw_cell(axes: Axes, x: float, y: float, rates: np.ndarray[Any, Any] | None) -> None:
    from matplotlib.patches import Rectangle

    colour = SUNK if rates is None else success_colour(float(rates.mean()))
    axes.add_patch(Rectangle((x, y), WIDE, HIGH, facecolor=colour, edgecolor=PAPER, linewidth=1.2))
    text, ink = (NONE, SOFT) if rates is None else (fixed(float(rates.mean())), ink_on(colour))
    axes.text(x + WIDE / 2, y + HIGH / 2, text, size=7.5, color=ink, ha="center", va="center")
