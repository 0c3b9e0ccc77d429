"""Figures of forests: lines of text, each with estimates and their intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from integ_gym.support.figures import (
    INK,
    LINE,
    PALETTE,
    PAPER,
    SOFT,
    axes_at,
    bare,
    blank_figure,
    draw_heading,
    fitting,
    inch_canvas,
    plain,
)

from ...verdict.rules import EQUIVALENCE_MARGIN, FAIL_MARGIN
from ..data.axes import Axis
from ..data.forest import Forest, Line, Mark

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PITCH: Final = 0.3  # inches from line to line
_SPLIT: Final = 0.42  # of a block's heading
_LEFT, _WIDTH, _RIGHT, _TOP, _BOTTOM = 4.7, 4.4, 2.6, 0.8, 0.55
_WHISKER: Final = 0.05
_LONGEST: Final = 90  # letters that fit the left margin when they are smallest


def draw_forest(forest: Forest) -> Figure:
    """All blocks, one under the other, on one axis."""
    tall = sum(_SPLIT + _PITCH * len(block.lines) for block in forest.blocks)
    figure = blank_figure(_LEFT + _WIDTH + _RIGHT, _TOP + tall + _BOTTOM)
    axes = axes_at(figure, _LEFT, _BOTTOM, _WIDTH, tall)
    _draw_axis(axes, forest.axis, tall)
    canvas = inch_canvas(figure)
    draw_heading(canvas, 0.3, forest.title, forest.about)
    behind = {"facecolor": PAPER, "edgecolor": "none", "pad": 1.5}
    names = [_who(line) for block in forest.blocks for line in block.lines]
    size = fitting(names, _LEFT - 0.45, 8.5)
    y = 0.0
    for block in forest.blocks:
        y += _SPLIT
        heading = plain(block.title, 120)
        canvas.text(0.3, _TOP + y - 0.1, heading, size=9, color=INK, weight="bold", bbox=behind)
        for line in block.lines:
            _draw_line(axes, canvas, line, forest.axis, y + _PITCH / 2, size)
            y += _PITCH
    return figure


def _draw_axis(axes: Axes, axis: Axis, tall: float) -> None:
    axes.set(xlim=(0.0, 1.0), ylim=(tall, 0.0), yticks=[])
    axes.set_xticks([axis.share(tick) for tick, _ in axis.ticks], [text for _, text in axis.ticks])
    axes.grid(axis="x", color=LINE, linewidth=0.7)
    axes.set_axisbelow(True)
    bare(axes)
    if axis.low < 0.0:
        axes.axvline(axis.share(0.0), color=SOFT, linewidth=0.8)
    if axis.margins:
        band = axis.share(-EQUIVALENCE_MARGIN), axis.share(EQUIVALENCE_MARGIN)
        axes.axvspan(*band, color=INK, alpha=0.07, linewidth=0)
        margin, red = axis.share(FAIL_MARGIN), PALETTE["fails"][0]
        axes.axvline(margin, color=red, linewidth=1.2, linestyle=(0, (4, 3)))


def _draw_line(axes: Axes, canvas: Axes, line: Line, axis: Axis, y: float, size: float) -> None:
    for mark in line.marks:
        _draw_mark(axes, mark, axis, y + 0.5 * _PITCH * mark.down)
    down = _TOP + y
    canvas.text(_LEFT - 0.15, down, _who(line), size=size, color=INK, ha="right", va="center")
    right = _LEFT + _WIDTH + 0.15
    canvas.text(right, down, line.number, size=8.5, color=INK, va="center", weight="bold")
    canvas.text(right + 0.47, down, line.detail, size=8, color=SOFT, va="center")


def _who(line: Line) -> str:
    note = f" ({line.note})" if line.note else ""
    return plain((f"{line.row} → " if line.row else "") + line.cell + note, _LONGEST)


def _draw_mark(axes: Axes, mark: Mark, axis: Axis, y: float) -> None:
    colour = PALETTE[mark.tone][0]
    if mark.value.bounded:
        low, high = (axis.share(end) for end in mark.value.ends)
        axes.plot([low, high], [y, y], color=colour, linewidth=1.5, solid_capstyle="butt")
        for end in (low, high):
            axes.plot([end, end], [y - _WHISKER, y + _WHISKER], color=colour, linewidth=1.1)
    face = colour if mark.filled else PAPER
    at = axis.share(mark.value.estimate)
    axes.plot(at, y, "o", color=colour, markerfacecolor=face, markersize=5.5, clip_on=False)
