"""Figure of losses of success: the declared family, then the largest of the rest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from integ_gym.eval.figure_style import (
    INK,
    PAPER,
    SOFT,
    axes_at,
    bare,
    blank_figure,
    draw_heading,
    inch_canvas,
    plain,
)
from integ_gym.eval.figures.cell import small
from integ_gym.eval.formatting import fixed
from integ_gym.eval.panel_model import Estimate, Panel
from integ_gym.eval.report.axes import difference_axis
from integ_gym.eval.report_data.gaps import Gap, declared_gaps, exploratory_gaps
from integ_gym.eval.verdict import EQUIVALENCE_MARGIN, FAIL_MARGIN

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_GAPS: Final = 24
"""Exploratory gaps drawn; the report lists more."""

VERDICT_COLOURS: Final = {
    "fails": "#b8400a",
    "transfers": "#00724f",
    "inconclusive": "#7a5a00",
}
"""Colours of verdicts, as in the report."""


def draw_gaps(panel: Panel) -> Figure | None:
    """Losses of success with intervals: the declared family, then the largest of the rest."""
    declared, exploratory = declared_gaps(panel), exploratory_gaps(panel)
    others = exploratory[:MAX_GAPS]
    lines = [*declared, *others]
    if not lines:
        return None
    pitch, left, width, top = 0.27, 4.9, 4.6, 1.05
    split = 0.45 if declared and others else 0.0
    tall = pitch * len(lines) + split
    figure = blank_figure(left + width + 1.9, top + tall + 0.85)
    high = float(figure.get_size_inches()[1])
    canvas = inch_canvas(figure)
    draw_heading(canvas, 0.3, "Transfer gaps", _gap_words(lines))
    axes = axes_at(figure, left, high - top - tall, width, tall)
    axes.set_ylim(tall, 0.0)
    _gap_frame(axes, [gap.value for gap in lines])
    for number, gap in enumerate(lines):
        y = pitch * (number + 0.5) + (split if number >= len(declared) else 0.0)
        _gap_line(axes, canvas, gap, y, (top + y, left, left + width))
    heads = [("declared family", 0.0, bool(declared))]
    hidden = len(exploratory) - len(others)
    rest = f"exploratory, the {len(others)} largest" if hidden else "exploratory"
    heads.append((rest, pitch * len(declared) + split, bool(others)))
    for text, y, shown in heads:
        if shown:
            canvas.text(0.3, top + y - 0.07, text, size=8.5, color=SOFT, va="baseline")
    small(canvas, left, high - 0.25, "loss of success; positive is worse")
    return figure


def _gap_words(gaps: Sequence[Gap]) -> str:
    text = (
        f"loss against policies trained there; band ±{EQUIVALENCE_MARGIN}, dashed line "
        f"{FAIL_MARGIN}; intervals over seeds, not adjusted"
    )
    return text + ("; * loss against home" if any(g.quantity == "home_drop" for g in gaps) else "")


def _gap_frame(axes: Axes, values: Sequence[Estimate]) -> None:
    axis = difference_axis(values)
    axes.set_xlim(axis.low - 0.03, axis.high + 0.03)
    axes.set_xticks(axis.ticks, [fixed(tick, 1) for tick in axis.ticks])
    axes.set_yticks([])
    axes.axvspan(-EQUIVALENCE_MARGIN, EQUIVALENCE_MARGIN, color=INK, alpha=0.07, linewidth=0)
    axes.axvline(0.0, color=SOFT, linewidth=0.8)
    axes.axvline(FAIL_MARGIN, color=VERDICT_COLOURS["fails"], linewidth=1.2, linestyle=(0, (4, 3)))
    bare(axes)


def _gap_line(
    axes: Axes, canvas: Axes, gap: Gap, y: float, place: tuple[float, float, float]
) -> None:
    colour = VERDICT_COLOURS.get(str(gap.verdict), SOFT) if gap.verdict else SOFT
    low, high = gap.value.ends
    axes.plot([low, high], [y, y], color=colour, linewidth=1.6, solid_capstyle="butt")
    for end in (low, high):
        axes.plot([end, end], [y - 0.05, y + 0.05], color=colour, linewidth=1.2)
    face = colour if gap.verdict else PAPER
    axes.plot(gap.value.estimate, y, "o", color=colour, markerfacecolor=face, markersize=6)
    down, left, right = place
    star = "*" if gap.quantity == "home_drop" else ""
    name = f"{plain(gap.row, 34)} → {plain(gap.cell, 34)}{star}"
    canvas.text(left - 0.15, down, name, size=8.5, color=INK, ha="right", va="center")
    numbers = f"{fixed(gap.value.estimate, 2, True)}"
    canvas.text(right + 0.15, down, numbers, size=8.5, color=INK, va="center", weight="bold")
    if gap.value.bounded:
        ends = f"{fixed(low)} to {fixed(high)}"
        canvas.text(right + 0.62, down, ends, size=8, color=SOFT, va="center")
