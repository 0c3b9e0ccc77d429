"""Figures of refinement ladders and sweeps: success against the step, or another argument."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

from integ_gym.support.figures import (
    INK,
    LINE,
    SOFT,
    Entry,
    axes_at,
    bare,
    blank_figure,
    draw_heading,
    draw_legend,
    inch_canvas,
    legend_lines,
    line_style,
    marker_style,
    plain,
    scheme_entries,
)

from ..data.axes import RATE_AXIS
from ..data.ladders import LadderPlot, LadderPlots, Series

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH, _HEIGHT, _SIDE, _BELOW = 2.55, 1.75, 0.62, 1.02  # inches of a plot, and between two
_ASIDE = 0.011  # of the width, by which lines are moved
_TRUTH: Final[dict[str, Any]] = {"color": INK, "linewidth": 1.3, "linestyle": (0, (4, 3))}


def draw_ladders(ladders: LadderPlots) -> Figure:
    """Every row's plots side by side, two rows across."""
    across = 2 if len(ladders.rows) > 1 else 1
    down = math.ceil(len(ladders.rows) / across)
    unit = (2 if ladders.paired else 1) * (_WIDTH + _SIDE) + 0.3
    wide = max(0.3 + across * unit, 6.9)
    legend = scheme_entries(ladders.schemes)
    if any(plot.truth is not None for _, plots in ladders.rows for plot in plots):
        legend.append(Entry("truth", _TRUTH))
    top = 1.3 + 0.2 * legend_lines(legend, wide)
    high = top + down * (_HEIGHT + _BELOW) + 0.1
    figure = blank_figure(wide, high)
    canvas = inch_canvas(figure)
    draw_heading(canvas, 0.3, ladders.title, ladders.about)
    draw_legend(canvas, legend, wide)
    for number, (row, plots) in enumerate(ladders.rows):
        x = 0.3 + (number % across) * unit
        y = top + (number // across) * (_HEIGHT + _BELOW)
        canvas.text(x, y - 0.02, plain(row), size=10, color=INK, weight="bold")
        for place, plot in enumerate(plots):
            left = x + 0.42 + place * (_WIDTH + _SIDE)
            axes = axes_at(figure, left, high - y - 0.32 - _HEIGHT, _WIDTH, _HEIGHT)
            _draw_plot(axes, plot)
    return figure


def _draw_plot(axes: Axes, plot: LadderPlot) -> None:
    axes.set(ylim=(-0.04, 1.06), xlim=(-0.15, 1.15))
    axes.set_yticks([tick for tick, _ in RATE_AXIS.ticks], [text for _, text in RATE_AXIS.ticks])
    axes.set_xticks([share for share, _ in plot.ticks], [text for _, text in plot.ticks])
    axes.grid(axis="y", color=LINE, linewidth=0.7)
    axes.set_axisbelow(True)
    axes.set_title(plot.about, size=8, color=SOFT, loc="left", pad=3)
    axes.set_xlabel(plot.along, size=8, color=SOFT, labelpad=1)
    bare(axes)
    if plot.truth is not None:
        axes.axhline(plot.truth.estimate, zorder=1.5, **_TRUTH)
    for series in plot.series:
        draw_series(axes, series)


def draw_series(
    axes: Axes, series: Series, *, whisker: float = 1.1, line: float = 1.6, marker: float = 1.0
) -> None:
    """One row's rates over the steps, with their intervals.

    Args:
        axes: of a plot.
        series: the row.
        whisker, line: widths, points.
        marker: factor on the size of markers.
    """
    xs = [point.x + _ASIDE * series.aside for point in series.points]
    for x, point in zip(xs, series.points, strict=True):
        axes.plot(
            [x, x], point.value.ends, color=series.style.colour, linewidth=whisker, alpha=0.45
        )
    rates = [point.value.estimate for point in series.points]
    style = {**line_style(series.style, line), **marker_style(series.style)}
    axes.plot(xs, rates, clip_on=False, **{**style, "markersize": marker * style["markersize"]})
