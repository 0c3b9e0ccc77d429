"""Refinement ladders across a page: one small plot for each row and kind of ladder."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

from integ_gym.support.figures import (
    INK,
    Entry,
    axes_at,
    blank_figure,
    inch_canvas,
    plain,
    scheme_entries,
)

from ...data.axes import RATE_AXIS
from ...data.ladders import LadderPlot, LadderPlots, thinned
from ..ladders import draw_series
from .sheet import COLUMN, LETTER, LINE_HEIGHT, PAGE, TYPE, framed, short

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LEFT, _GAP, _HEIGHT, _ABOVE, _BELOW = 0.5, 0.28, 1.0, 0.36, 0.42  # inches
_KEY: Final = 0.34  # inches of a line in the legend, with its gap
_TRUTH: Final[dict[str, Any]] = {"color": INK, "linewidth": 0.9, "linestyle": (0, (4, 3))}


def print_ladders(ladders: LadderPlots) -> Figure:
    """Plots in reading order under one legend; four across a page, two across a column."""
    plots = [(row, plot) for row, own in ladders.rows for plot in own]
    wide, across = (COLUMN, 2) if len(plots) <= 2 else (PAGE, 4)
    unit = (wide - _LEFT + _GAP - 0.08) / across
    legend = scheme_entries(ladders.schemes)
    if any(plot.truth is not None for _, plot in plots):
        legend.append(Entry("truth", _TRUTH))
    places = _legend_places(legend, wide)
    top = LINE_HEIGHT * (places[-1][1] + 1) + 0.06
    down = math.ceil(len(plots) / across)
    high = top + down * (_ABOVE + _HEIGHT + _BELOW)
    figure = blank_figure(wide, high)
    canvas = inch_canvas(figure)
    for entry, (x, line) in zip(legend, places, strict=True):
        _draw_entry(canvas, entry, x, 0.1 + LINE_HEIGHT * line)
    for number, (row, plot) in enumerate(plots):
        left = _LEFT + (number % across) * unit
        y = top + (number // across) * (_ABOVE + _HEIGHT + _BELOW)
        for line, words in enumerate((row, _about(plot))):
            said = short(words, unit - 0.08)
            canvas.text(left, y + (line + 0.7) * LINE_HEIGHT, said, va="center", **TYPE)
        axes = axes_at(figure, left, high - y - _ABOVE - _HEIGHT, unit - _GAP, _HEIGHT)
        letter = LETTER / (unit - _GAP)
        _draw_plot(axes, plot, "success" if number % across == 0 else "", letter)
    return figure


def _about(plot: LadderPlot) -> str:
    """What happens to the control period, shortly."""
    return plot.about.replace("control period", "control")


def _draw_plot(axes: Axes, plot: LadderPlot, up: str, letter: float) -> None:
    axes.set(ylim=(-0.05, 1.08), xlim=(-0.12, 1.12))
    words = [text if up else "" for _, text in RATE_AXIS.ticks]
    axes.set_yticks([tick for tick, _ in RATE_AXIS.ticks], words)
    ticks = thinned(plot.ticks, letter)
    axes.set_xticks([share for share, _ in ticks], [text for _, text in ticks])
    framed(axes, plot.along, up)
    if plot.truth is not None:
        axes.axhline(plot.truth.estimate, zorder=1.5, **_TRUTH)
    for series in plot.series:
        draw_series(axes, series, whisker=0.8, line=1.1, marker=0.7)


def _legend_places(entries: list[Entry], wide: float) -> list[tuple[float, int]]:
    """Left edge of every entry, inches, and its line."""
    places: list[tuple[float, int]] = []
    x, line = 0.08, 0
    for entry in entries:
        size = _KEY + LETTER * len(plain(entry.label, 26))
        if x + size > wide and places:
            x, line = 0.08, line + 1
        places.append((x, line))
        x += size + 0.1
    return places


def _draw_entry(canvas: Axes, entry: Entry, x: float, y: float) -> None:
    canvas.plot([x, x + 0.26], [y, y], **entry.line)
    if entry.marker is not None:
        smaller = {**entry.marker, "markersize": 0.7 * entry.marker["markersize"]}
        canvas.plot([x + 0.13], [y], linestyle="none", **smaller)
    canvas.text(x + _KEY - 0.04, y, plain(entry.label, 26), va="center", **TYPE)
