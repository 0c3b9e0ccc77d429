"""An atlas's phase diagram, table of success and losses, from its summaries alone."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path

from integ_gym.support.errors import InputError
from integ_gym.support.figures import write_figure
from integ_gym.support.files import make_folder, replace_file
from integ_gym.support.terminal import NONE, fixed

from ..statistics import draws_for, paired_difference, rate_interval
from .figures import draw_phases
from .running import finished
from .specification import Atlas
from .summaries import Point, noted_in, points

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
    found = points(atlas, done, noted_in(summaries))
    make_folder(out)
    homes = [home.name for home in atlas.panel.train]
    files = write_figure(draw_phases(atlas.name, found, homes, atlas.ratios), out / "phases")
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
        cells = [_rate(by_place.get((home, ratio))) for ratio in ratios]
        yield f"| {home} | " + " | ".join(cells) + " |"


def _rate(point: Point | None) -> str:
    if point is None:
        return NONE
    own = rate_interval(point.on_truth, draws=draws_for(len(point.on_truth)))
    return f"{fixed(own.estimate)} ({fixed(own.low)}–{fixed(own.high)})"


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
        numbers = (*rates, lost.estimate, lost.low, lost.high)
        table.writerow(
            [point.home.name, f"{point.ratio:g}", len(point.seeds)]
            + [f"{number:z.4f}" for number in numbers]
        )
    return text.getvalue().encode()
