"""Figure of a panel's mixtures: their success beside that of single discretizations."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from integ_gym.eval.figure_style import (
    ACCENT,
    INK,
    PAPER,
    SOFT,
    blank_figure,
    draw_heading,
    inch_canvas,
    plain,
)
from integ_gym.eval.figures.gaps import VERDICT_COLOURS
from integ_gym.eval.figures.rate_axes import rate_axes
from integ_gym.eval.formatting import fixed
from integ_gym.eval.panel_model import Panel
from integ_gym.eval.report_data.remedy import Line, Remedy, remedies_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LOST: Final = VERDICT_COLOURS["fails"]
"""Colour of a policy that loses success."""

_PITCH, _LEFT, _WIDTH, _TOP, _SPLIT = 0.3, 3.4, 4.4, 0.95, 0.42


def draw_remedy(panel: Panel) -> Figure | None:
    """Every discretization in which single ones lose, the worst first, by mixture."""
    found = [remedy for remedy in remedies_of(panel) if remedy.harmful]
    if not found:
        return None
    tall = sum(_SPLIT + _PITCH * len(remedy.harmful) for remedy in found)
    figure = blank_figure(_LEFT + _WIDTH + 1.7, _TOP + tall + 0.75)
    canvas = inch_canvas(figure)
    canvas.set_zorder(1)
    about = (
        "success; dot: mixture, with its interval; rings: single ones, red where they lose > 0.2"
    )
    draw_heading(canvas, 0.3, "A remedy: training on a mixture", about)
    axes = rate_axes(figure, _LEFT, _TOP, _WIDTH, tall)
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
        name = plain(line.entry.cell, 34) + (" (trained there)" if line.member else "")
        down = _TOP + middle
        canvas.text(_LEFT - 0.15, down, name, size=8.5, color=INK, ha="right", va="center")
        others = f"others {fixed(line.lowest)} to {fixed(line.highest)}"
        numbers = f"{fixed(line.entry.success.estimate)}, {others}"
        canvas.text(_LEFT + _WIDTH + 0.15, down, numbers, size=8, color=INK, va="center")


def _draw_line(axes: Axes, line: Line, y: float) -> None:
    for rival in line.rivals:
        colour = LOST if rival.lost else SOFT
        axes.plot(
            rival.entry.success.estimate, y - 0.05, "o", color=colour, markerfacecolor=PAPER,
            markersize=5.5,
        )  # fmt: skip
    axes.plot(line.entry.success.ends, [y + 0.05] * 2, color=ACCENT, linewidth=1.5)
    axes.plot(line.entry.success.estimate, y + 0.05, "o", color=ACCENT, markersize=6)
