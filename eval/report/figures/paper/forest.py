"""Forests in a column: each line's name above its interval."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from integ_gym.support.figures import (
    PALETTE,
    PAPER,
    SOFT,
    axes_at,
    blank_figure,
    inch_canvas,
)

from ....verdict.rules import EQUIVALENCE_MARGIN, FAIL_MARGIN
from ...data.axes import Axis
from ...data.forest import Forest, Line, Mark
from .sheet import COLUMN, LINE_HEIGHT, TYPE, framed, short

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PITCH: Final = 1.7 * LINE_HEIGHT
_HEADING: Final = 1.5 * LINE_HEIGHT
_EDGE, _RIGHT, _BOTTOM = 0.12, 0.5, 0.4
_WHISKER: Final = 0.03


def print_forest(forest: Forest) -> Figure:
    """All blocks, one under the other, on one axis."""
    tall = sum(_HEADING + _PITCH * len(block.lines) for block in forest.blocks)
    figure = blank_figure(COLUMN, tall + _BOTTOM + 0.06)
    width = COLUMN - _EDGE - _RIGHT
    axes = axes_at(figure, _EDGE, _BOTTOM, width, tall)
    _draw_axis(axes, forest.axis, forest.along, tall)
    canvas = inch_canvas(figure)
    y = 0.0
    for block in forest.blocks:
        heading = short(block.title, COLUMN - 2 * _EDGE)
        canvas.text(_EDGE, 0.06 + y + 0.6 * _HEADING, heading, va="center", weight="bold", **TYPE)
        y += _HEADING
        for line in block.lines:
            _draw_line(axes, canvas, line, forest.axis, y)
            y += _PITCH
    return figure


def _draw_axis(axes: Axes, axis: Axis, along: str, tall: float) -> None:
    axes.set(xlim=(0.0, 1.0), ylim=(tall, 0.0))
    axes.set_xticks([axis.share(tick) for tick, _ in axis.ticks], [text for _, text in axis.ticks])
    framed(axes, along, "")
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    if axis.margins:
        band = axis.share(-EQUIVALENCE_MARGIN), axis.share(EQUIVALENCE_MARGIN)
        axes.axvspan(*band, color=SOFT, alpha=0.12, linewidth=0)
        red = PALETTE["fails"][0]
        axes.axvline(axis.share(FAIL_MARGIN), color=red, linewidth=0.9, linestyle=(0, (4, 3)))


def _draw_line(axes: Axes, canvas: Axes, line: Line, axis: Axis, y: float) -> None:
    """Name and number above, the marks below."""
    who = f"{line.row} → {line.cell}" if line.row else f"{line.cell} {line.note}".strip()
    behind = {"facecolor": PAPER, "edgecolor": "none", "pad": 0.6}
    middle = 0.06 + y + 0.5 * LINE_HEIGHT
    name = short(who, COLUMN - _EDGE - _RIGHT + 0.25)
    canvas.text(_EDGE, middle, name, va="center", bbox=behind, **TYPE)
    canvas.text(COLUMN - _EDGE, middle, line.number, va="center", ha="right", **TYPE)
    for mark in line.marks:
        _draw_mark(axes, mark, axis, y + (1.3 + 0.2 * mark.down) * LINE_HEIGHT)


def _draw_mark(axes: Axes, mark: Mark, axis: Axis, y: float) -> None:
    colour = PALETTE[mark.tone][0]
    if mark.value.bounded:
        low, high = (axis.share(end) for end in mark.value.ends)
        axes.plot([low, high], [y, y], color=colour, linewidth=1.1, solid_capstyle="butt")
        for end in (low, high):
            axes.plot([end, end], [y - _WHISKER, y + _WHISKER], color=colour, linewidth=0.8)
    face = colour if mark.filled else PAPER
    at = axis.share(mark.value.estimate)
    axes.plot(at, y, "o", color=colour, markerfacecolor=face, markersize=3.8, clip_on=False)
