"""Figure of perturbations: success before and after each."""

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
from integ_gym.eval.figures.rate_axes import rate_axes
from integ_gym.eval.formatting import NONE, fixed
from integ_gym.eval.panel_model import Panel
from integ_gym.eval.report_data.checks import Check, checks_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_CHECKS: Final = 40
"""Rows drawn for each perturbation."""


def draw_checks(panel: Panel) -> Figure | None:
    """Success before and after every change of the plant or its delays."""
    blocks = [(label, found[:MAX_CHECKS]) for label, found in checks_of(panel).items()]
    if not blocks:
        return None
    pitch, left, width, top, split = 0.3, 4.6, 4.2, 0.95, 0.42
    tall = sum(split + pitch * len(found) for _, found in blocks)
    figure = blank_figure(left + width + 1.6, top + tall + 0.75)
    canvas = inch_canvas(figure)
    about = "success with its interval over seeds: ring as specified, dot with the change"
    draw_heading(canvas, 0.3, "Perturbations and latency", about)
    axes = rate_axes(figure, left, top, width, tall)
    y = 0.0
    for label, found in blocks:
        y += split
        canvas.text(0.3, top + y - 0.1, plain(label), size=10, color=INK, weight="bold")
        for check in found:
            _check_line(axes, canvas, check, y + pitch / 2, (top + y + pitch / 2, left, width))
            y += pitch
    return figure


def _check_line(
    axes: Axes, canvas: Axes, check: Check, y: float, place: tuple[float, float, float]
) -> None:
    before = None if check.before is None else check.before.success
    after = check.after.success
    for value, shift, colour, face in (
        (before, -0.045, SOFT, PAPER),
        (after, 0.045, ACCENT, ACCENT),
    ):
        if value is not None:
            axes.plot(value.ends, [y + shift] * 2, color=colour, linewidth=1.5)
            axes.plot(
                value.estimate, y + shift, "o", color=colour, markerfacecolor=face, markersize=5.5
            )
    down, left, width = place
    cell = check.after.cell if check.before is None else check.before.cell
    name = f"{plain(check.after.row, 29)} → {plain(cell, 29)}"
    canvas.text(left - 0.15, down, name, size=8.5, color=INK, ha="right", va="center")
    numbers = " → ".join(fixed(v.estimate) if v is not None else NONE for v in (before, after))
    canvas.text(left + width + 0.15, down, numbers, size=8.5, color=INK, va="center")
