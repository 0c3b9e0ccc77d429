"""An atlas's phase diagram, table of success and losses, from its summaries alone."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from integ_gym.support import figures
from integ_gym.support.errors import InputError
from integ_gym.support.files import make_folder, replace_file
from integ_gym.support.terminal import NONE, fixed

from ..statistics import draws_for, paired_difference, rate_interval
from .running import finished
from .specification import Atlas
from .summaries import Point, points, read_agreements

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


WIDE, HIGH = 0.5, 0.27  # inches of a cell
_LEFT, _TOP, _GAP = 2.8, 1.35, 0.5
_NARROWEST = 9.2
"""Figure that its heading fits, in."""


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
    figure = figures.blank_figure(width, _TOP + HIGH * len(homes) + 0.55)
    axes = figures.inch_canvas(figure)
    figures.draw_heading(
        axes, 0.3, f"{name}: where a policy learns, and what it keeps",
        "mean success of policies by what they were trained on (rows) and the limit of the control "
        "over the least that the truth takes (columns)",
    )  # fmt: skip
    by_place = {(point.home.name, point.ratio): point for point in found}
    for side, title in enumerate(("at home", "on the truth")):
        left = _LEFT + side * (across + _GAP)
        axes.text(left, _TOP - 0.32, title, size=10, weight="bold", color=figures.INK)
        for k, ratio in enumerate(ratios):
            x = left + WIDE * (k + 0.5)
            axes.text(x, _TOP - 0.1, f"{ratio:g}", size=8, color=figures.SOFT, ha="center")
            for row, home in enumerate(homes):
                point = by_place.get((home, ratio))
                rates = None if point is None else (point.at_home, point.on_truth)[side]
                _draw_cell(axes, left + WIDE * k, _TOP + HIGH * row, rates)
    for row, home in enumerate(homes):
        y = _TOP + HIGH * (row + 0.5)
        own = home.rpartition(":")[2]  # of a map of one's own, "module:Class"
        axes.text(_LEFT - 0.12, y, own, size=8, color=figures.INK, ha="right", va="center")
    return figure


def _draw_cell(axes: Axes, x: float, y: float, rates: np.ndarray[Any, Any] | None) -> None:
    from matplotlib.patches import Rectangle

    colour = figures.SUNK if rates is None else figures.success_colour(float(rates.mean()))
    axes.add_patch(
        Rectangle((x, y), WIDE, HIGH, facecolor=colour, edgecolor=figures.PAPER, linewidth=1.2)
    )
    text, ink = (
        (NONE, figures.SOFT)
        if rates is None
        else (fixed(float(rates.mean())), figures.ink_on(colour))
    )
    axes.text(x + WIDE / 2, y + HIGH / 2, text, size=7.5, color=ink, ha="center", va="center")


TABLES, LOSSES = "tables.md", "losses.csv"


def publish(atlas: Atlas, summaries: Path, out: Path) -> list[Path]:
    """Write the phase diagram, the table of success on the truth and every loss.

    Args:
        atlas: whose summaries they are.
        summaries: their folder.
        out: folder of what is written.

    Returns:
        The files.

    Raises:
        ValueError: if there is no summary, or summaries may not be combined.
    """
    done = finished(atlas, summaries)
    if not done:
        raise InputError(f"no block of atlas {atlas.name!r} has a summary in {summaries}")
    found = points(atlas, done, read_agreements(summaries))
    make_folder(out)
    homes = [home.name for home in atlas.panel.train]
    files = figures.write_figure(
        draw_phases(atlas.name, found, homes, atlas.ratios), out / "phases"
    )
    files.append(replace_file(out / LOSSES, _losses(found)))
    files.append(replace_file(out / TABLES, ("\n".join(_phase_table(found)) + "\n").encode()))
    return files


def _phase_table(found: Sequence[Point]) -> Iterator[str]:
    """Success on the truth with its interval, as Markdown."""
    ratios = sorted({point.ratio for point in found})
    by_place = {(point.home.name, point.ratio): point for point in found}
    yield "| trained on | " + " | ".join(f"{ratio:g}" for ratio in ratios) + " |"
    yield "|---" * (len(ratios) + 1) + "|"
    for home in dict.fromkeys(point.home.name for point in found):
        cells = []
        for ratio in ratios:
            point = by_place.get((home, ratio))
            if point is None:
                cells.append(NONE)
                continue
            own = rate_interval(point.on_truth, draws=draws_for(len(point.on_truth)))
            cells.append(f"{fixed(own.estimate)} ({fixed(own.low)}–{fixed(own.high)})")
        yield f"| {home} | " + " | ".join(cells) + " |"


def _losses(found: Sequence[Point]) -> bytes:
    """Success at home less success on the truth, with its 95 % interval, as CSV.

    Only where the task was learned at home.
    """
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(
        ["trained on", "limit over critical", "seeds", "success at home", "success on the truth",
         "within twice the time", "loss", "loss low", "loss high"]
    )  # fmt: skip
    for point in found:
        if not point.learned:
            continue
        lost = paired_difference(point.at_home, point.on_truth, 0.95).interval
        rates = (point.at_home.mean(), point.on_truth.mean(), point.recovered.mean())
        numbers = (*rates, lost.estimate, *lost.ends)
        table.writerow(
            [point.home.name, f"{point.ratio:g}", len(point.seeds)]
            + [f"{number:z.4f}" for number in numbers]
        )
    return text.getvalue().encode()
