"""Figure of a panel's mixtures: their success beside that of single discretizations."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from integ_gym.eval.figure_style import (
    ACCENT,
    INK,
    LINE,
    PAPER,
    SOFT,
    axes_at,
    bare,
    blank_figure,
    draw_heading,
    inch_canvas,
    plain,
)
from integ_gym.eval.report_data import Panel, fixed
from integ_gym.eval.report_remedy import Line, Remedy, remedies_of, success_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LOST: Final = "#b8400a"
"""Colour of a policy that loses success, as that of the verdict `fails`."""

_PITCH, _LEFT, _WIDTH, _TOP, _SPLIT = 0.3, 3.4, 4.4, 0.95, 0.42


def draw_remedy(panel: Panel) -> Figure | None:
    """Every discretization in which single ones lose, the worst first, by mixture."""
    found = [remedy for remedy in remedies_of(panel) if remedy.harmful]
    if not found:
        return None
    tall = sum(_SPLIT + _PITCH * len(remedy.harmful) for remedy in found)
    figure = blank_figure(_LEFT + _WIDTH + 1.7, _TOP + tall + 0.75)
    high = float(figure.get_size_inches()[1])
    canvas = inch_canvas(figure)
    canvas.set_zorder(1)
    about = (
        "success; dot: mixture, with its interval; rings: single ones, red where they lose > 0.2"
    )
    draw_heading(canvas, 0.3, "A remedy: training on a mixture", about)
    axes = axes_at(figure, _LEFT, high - _TOP - tall, _WIDTH, tall)
    axes.set(xlim=(-0.02, 1.02), ylim=(tall, 0.0), yticks=[])
    axes.set_xticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0", "0.25", "0.5", "0.75", "1"])
    axes.grid(axis="x", color=LINE, linewidth=0.7)
    axes.set_axisbelow(True)
    bare(axes)
    y = 0.0
    for remedy in found:
        y += _SPLIT
        _draw_block(axes, canvas, remedy, y)
        y += _PITCH * len(remedy.harmful)
    return figure


def _draw_block(axes: Axes, canvas: Axes, remedy: Remedy, y: float) -> None:
    """One mixture, its heading above ``y``, inches below the top of the axes."""
    title = plain(f"{remedy.row.name}: {remedy.members}", 100)
    behind = {"facecolor": PAPER, "edgecolor": "none", "pad": 1.5}
    canvas.text(0.3, _TOP + y - 0.1, title, size=9, color=INK, weight="bold", bbox=behind)
    for place, line in enumerate(remedy.harmful):
        middle = y + _PITCH * (place + 0.5)
        _draw_line(axes, line, middle)
        name = plain(line.entry.cell.name, 34) + (" (trained there)" if line.member else "")
        down = _TOP + middle
        canvas.text(_LEFT - 0.15, down, name, size=8.5, color=INK, ha="right", va="center")
        others = f"others {fixed(line.lowest)} to {fixed(line.highest)}"
        numbers = f"{fixed(success_of(line.entry))}, {others}"
        canvas.text(_LEFT + _WIDTH + 0.15, down, numbers, size=8, color=INK, va="center")


def _draw_line(axes: Axes, line: Line, y: float) -> None:
    for rival in line.rivals:
        colour = LOST if rival.lost else SOFT
        axes.plot(
            success_of(rival.entry), y - 0.05, "o", color=colour, markerfacecolor=PAPER,
            markersize=5.5,
        )  # fmt: skip
    if line.entry.success is not None:
        axes.plot(line.entry.success.ends, [y + 0.05] * 2, color=ACCENT, linewidth=1.5)
        axes.plot(line.entry.success.estimate, y + 0.05, "o", color=ACCENT, markersize=6)
