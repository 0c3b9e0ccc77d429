"""Figure of refinement ladders: success against the step."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final, TypeAlias

from integ_gym.eval.figure_style import (
    INK,
    LINE,
    PAPER,
    SCHEME_COLOURS,
    SCHEME_MARKERS,
    SOFT,
    axes_at,
    bare,
    blank_figure,
    draw_heading,
    inch_canvas,
    plain,
    scheme_legend,
)
from integ_gym.eval.formatting import step
from integ_gym.eval.panel_model import Estimate, Panel
from integ_gym.eval.report_data.ladders import Ladder, Rung, ladders_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Rungs: TypeAlias = Mapping[str, tuple[Rung, ...]]
"""For every scheme, rungs from coarse to fine."""

MAX_LADDERS: Final = 12
"""Rows whose refinement ladders are drawn."""


def draw_ladders(panel: Panel) -> Figure | None:
    """Success against the step: control period fixed on the left, following it on the right."""
    ladders = ladders_of(panel)[:MAX_LADDERS]
    if not ladders:
        return None
    follows = any(ladder.following for ladder in ladders)
    names = dict.fromkeys(name for ladder in ladders for name in (*ladder.fixed, *ladder.following))
    schemes = {name: place for place, name in enumerate(names)}
    across = 2 if len(ladders) > 1 else 1
    plots = 2 if follows else 1
    down = math.ceil(len(ladders) / across)
    width, height, side, top = 2.55, 1.75, 0.62, 1.5
    unit = plots * (width + side) + 0.3
    figure = blank_figure(max(0.3 + across * unit, 6.9), top + down * (height + 1.02) + 0.1)
    high = float(figure.get_size_inches()[1])
    canvas = inch_canvas(figure)
    about = "success of the same policies as the step shrinks; finer to the right"
    about += "" if panel.truth is None else ", dashed: truth"
    draw_heading(canvas, 0.3, "Refinement ladder", about)
    scheme_legend(canvas, schemes, float(figure.get_size_inches()[0]))
    for number, ladder in enumerate(ladders):
        x = 0.3 + (number % across) * unit
        y = top + (number // across) * (height + 1.02)
        canvas.text(x, y - 0.02, plain(ladder.row.name), size=10, color=INK, weight="bold")
        for place, (words, rungs, truth) in enumerate(_ladder_plots(ladder)):
            if rungs:
                left = x + 0.42 + place * (width + side)
                axes = axes_at(figure, left, high - y - 0.32 - height, width, height)
                _ladder_axes(axes, rungs, schemes, truth, words)
    return figure


def _ladder_plots(ladder: Ladder) -> tuple[tuple[str, Rungs, Estimate | None], ...]:
    truth = None if ladder.truth is None else ladder.truth.success
    period = "" if ladder.control_period is None else f" at {step(ladder.control_period)} s"
    return (
        (f"control period fixed{period}", ladder.fixed, truth),
        ("control period follows the step", ladder.following, None),
    )


def _ladder_axes(
    axes: Axes,
    rungs: Rungs,
    schemes: dict[str, int],
    truth: Estimate | None,
    words: str,
) -> None:
    steps = sorted({rung.dt for line in rungs.values() for rung in line}, reverse=True)
    axes.set(ylim=(-0.04, 1.06), xlim=(-0.35, math.log2(steps[0] / steps[-1]) + 0.35))
    axes.set_yticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0", "0.25", "0.5", "0.75", "1"])
    ticks = steps if len(steps) < 6 else steps[:: math.ceil(len(steps) / 5)]
    axes.set_xticks([math.log2(steps[0] / dt) for dt in ticks], [step(dt) for dt in ticks])
    axes.grid(axis="y", color=LINE, linewidth=0.7)
    axes.set_axisbelow(True)
    axes.set_title(words, size=8, color=SOFT, loc="left", pad=3)
    axes.set_xlabel("step, s", size=8, color=SOFT, labelpad=1)
    bare(axes)
    if truth is not None:
        axes.axhline(truth.estimate, color=INK, linewidth=1.3, linestyle=(0, (4, 3)), zorder=1.5)
    for name, line in rungs.items():
        _ladder_line(axes, line, schemes[name], len(schemes), steps[0])


def _ladder_line(axes: Axes, line: Sequence[Rung], place: int, count: int, coarsest: float) -> None:
    """One integrator, moved aside a little so that equal rates stay visible."""
    colour = SCHEME_COLOURS[place % len(SCHEME_COLOURS)]
    marker = SCHEME_MARKERS[place % len(SCHEME_MARKERS)]
    aside = (place - (count - 1) / 2.0) * 0.028
    rates = [rung.entry.success for rung in line]
    xs = [math.log2(coarsest / rung.dt) + aside for rung in line]
    known = list(zip(xs, rates, strict=True))
    for x, rate in known:
        axes.plot([x, x], rate.ends, color=colour, linewidth=1.1, alpha=0.45)
    axes.plot(
        [x for x, _ in known], [rate.estimate for _, rate in known], color=colour, marker=marker,
        linewidth=1.6, markersize=5, markeredgecolor=PAPER, markeredgewidth=0.6, clip_on=False,
    )  # fmt: skip
