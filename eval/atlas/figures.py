"""Figures of an atlas: the phase diagram, and losses over one number."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from integ_gym.support import (
    INK,
    NONE,
    PAPER,
    SOFT,
    SUNK,
    axes_at,
    bare,
    blank_figure,
    draw_heading,
    draw_legend,
    fixed,
    inch_canvas,
    ink_on,
    marker_style,
    percent,
    scheme_entries,
    success_colour,
)

from ..scheme_style import styles_of
from .numbers import Term, terms_of
from .prediction import LEVEL, Curve, Line, off_by_chance, telling
from .summaries import Point

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDE, HIGH = 0.5, 0.27  # inches of a cell
_LEFT, _TOP, _GAP = 2.8, 1.35, 0.5
_NARROWEST = 9.2
"""Figure that its heading fits, in."""

_PANEL = 5.4
"""Width of one part's losses, in."""

_PARTS = {
    "whole": "share of the success at home that is lost",
    "out of step": "what is lost, less what goes by power",
    "helped": "what is lost, less what goes by reactive force",
}

SMALLEST = 1e-3
"""Of a number, where losses begin to be drawn."""


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


def draw_losses(
    name: str, found: Sequence[Point], held_out: Sequence[float], curve: Curve
) -> Figure:
    """Losses of all that learned over one number, or what others leave of them, with the fit.

    Args:
        name: of the atlas.
        found: its points.
        held_out: limits of the control that the fit has not seen.
        curve: that was fitted.
    """
    terms, learned = terms_of(curve.number), telling(found)
    wide = _PANEL + 1.0
    figure = blank_figure(max(len(terms) * wide, 7.2), 5.1)
    canvas = inch_canvas(figure)
    draw_heading(
        canvas, 0.3, f"{name}: loss by {curve.number}",
        f"open: held out of the fit; bars: {percent(LEVEL)} over seeds; expected {_widths(curve)}",
    )  # fmt: skip
    styles = styles_of(point.known.home.integrator for point in learned)
    chances = [off_by_chance(point) for point in learned]
    for place, (term, line) in enumerate(zip(terms, curve.lines, strict=True)):
        axes = axes_at(figure, 0.75 + place * wide, 0.65, _PANEL, 3.0)
        bare(axes)
        _draw_line(axes, term, line, learned, curve)
        for point, chance in zip(learned, chances, strict=True):
            style = styles[point.known.home.integrator]
            look = {**marker_style(style), "markeredgecolor": style.colour, "markeredgewidth": 1.0}
            fill = PAPER if point.ratio in held_out else style.colour
            at = max(term.number(point.known), SMALLEST)
            parts = curve.parts(point.known)
            left = point.loss - sum(parts.values()) + parts[term.part]
            axes.errorbar(
                [at], [left], chance, ecolor=style.colour, elinewidth=0.7,
                linestyle="none", color=fill, **look,
            )  # fmt: skip
    draw_legend(canvas, scheme_entries(styles), len(terms) * wide)
    return figure


def _widths(curve: Curve) -> str:
    """Half widths of its intervals, in words."""
    quiet, little, more = map(fixed, curve.half_widths)
    return (
        f"±{quiet} where the numerics do next to nothing, ±{little} where little is expected, "
        f"±{more} elsewhere"
    )


def _draw_line(axes: Axes, term: Term, line: Line, learned: Sequence[Point], curve: Curve) -> None:
    """What was fitted by one number; the interval is that of the whole loss."""
    most = max(term.number(point.known) for point in learned)
    at = np.geomspace(SMALLEST, max(1.1 * most, 2 * SMALLEST), 400)
    loss = line(at)
    if term.part == "whole":
        wide = curve.half_width(np.inf, loss)
        axes.fill_between(at, loss - wide, loss + wide, color=SUNK, linewidth=0)
    axes.plot(at, loss, color=INK, linewidth=1.4)
    axes.set_xscale("log")
    axes.set_xlabel(
        f"{term.name}\n(log scale; what is smaller stands at the edge)", size=9, color=INK
    )
    axes.set_ylabel(_PARTS[term.part], size=9, color=INK)
    axes.set_ylim(-0.15, 1.05)
