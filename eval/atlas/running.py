"""An atlas's blocks, run one after the other, and what is drawn of their summaries alone.

What has a summary is not run again. Drawn and written are the phase diagram, the table of success
and the losses.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from integ_gym.support import figures
from integ_gym.support.errors import InputError
from integ_gym.support.files import make_folder, replace_file
from integ_gym.support.terminal import NONE, fixed

from ..panel.run import run_panel
from ..report.drawing import draw_box
from ..statistics import draws_for, paired_difference, rate_interval
from . import summaries
from .specification import Atlas, Block

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def summary_path(folder: Path, block: Block) -> Path:
    """Where the summary of a block lies."""
    return folder / f"{block.name}.parquet"


def finished(atlas: Atlas, folder: Path) -> list[tuple[Block, summaries.Summary]]:
    """Blocks that have a summary, with it.

    Args:
        atlas: what is run.
        folder: of the summaries.

    Raises:
        ValueError: if a summary is of another specification.
    """
    found = []
    for block in atlas.blocks():
        path = summary_path(folder, block)
        if not path.exists():
            continue
        summary = summaries.read_summary(path)
        if summary.origin.specification != msgspec.to_builtins(block.panel.to_json()):
            raise InputError(
                f"{path} is of another specification than block {block.name}; give another folder "
                "with --summaries, or remove it to run the block again"
            )
        found.append((block, summary))
    return found


def missing(atlas: Atlas, folder: Path) -> list[Block]:
    """Blocks that have no summary; see :func:`finished`."""
    there = {block.name for block, _ in finished(atlas, folder)}
    return [block for block in atlas.blocks() if block.name not in there]


def run_blocks(
    atlas: Atlas,
    blocks: Sequence[Block],
    out: Path,
    folder: Path,
    *,
    workers: int | None = None,
    progress: bool = True,
) -> Iterator[tuple[Block, summaries.Summary]]:
    """Run blocks, each to its page and its summary, as they are asked for.

    Args:
        atlas: what is run.
        blocks: some of its blocks.
        out: directory of the runs, one for each block; what was begun is finished.
        folder: of the summaries.
        workers: processes; by default one per core.
        progress: show bars on stderr.

    Raises:
        SpecError, RunDirectoryError, PanelError, TrainingError: see :func:`run_panel`.
    """
    for block in blocks:
        run = out / block.name
        run_panel(block.panel, run, workers=workers, progress=progress, command="integ-gym atlas")
        summary = summaries.summarize(run, atlas.name, block)
        summaries.write_summary(summary, summary_path(folder, block))
        yield block, summary


def again(
    atlas: Atlas, block: Block, out: Path, folder: Path, *, workers: int | None = None
) -> summaries.Agreement:
    """Run a finished block anew, and note that its outcomes are the same.

    Its first two seeds tell, where they come out the same or the processor is the same: a policy
    that is trained alone may round otherwise than beside others. Otherwise the whole block is run,
    and agrees or not by :func:`compare`.

    Args:
        atlas: what is run.
        block: one of its blocks.
        out: directory for the run; what an earlier version left there is refused.
        folder: of the summaries.
        workers: processes; by default one per core.

    Raises:
        ValueError: if the block has no summary, or its outcomes are others.
        SpecError, RunDirectoryError, PanelError, TrainingError: see :func:`run_panel`.
    """
    path = summary_path(folder, block)
    if not path.exists():
        raise InputError(f"block {block.name} has no summary in {folder}; run it first")
    before, run = summaries.read_summary(path), out / f"{block.name}-again"
    few = replace(block, panel=replace(block.panel, seeds=block.panel.seeds[:2]))
    for part in (few, block):
        run_panel(part.panel, run, workers=workers, command="integ-gym atlas --again")
        fresh = summaries.summarize(run, atlas.name, part)
        if not summaries.first_difference(before, fresh) or summaries.same_processor(before, fresh):
            break
    found = summaries.compare(block.name, before, fresh)
    summaries.note(found, folder)
    return found


WIDE, HIGH = 0.5, 0.27  # inches of a cell
_LEFT, _TOP, _GAP = 2.8, 1.35, 0.5
_NARROWEST = 9.2
"""Figure that its heading fits, in."""


def draw_phases(
    name: str, found: Sequence[summaries.Point], homes: Sequence[str], ratios: Sequence[float]
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
    colour, text, ink = figures.SUNK, NONE, figures.SOFT
    if rates is not None:
        colour = figures.success_colour(float(rates.mean()))
        text, ink = fixed(float(rates.mean())), figures.ink_on(colour)
    edge = {"edgecolor": figures.PAPER, "linewidth": 1.2}
    draw_box(axes, (x, y), (WIDE, HIGH), 0.0, facecolor=colour, **edge)
    axes.text(x + WIDE / 2, y + HIGH / 2, text, size=7.5, color=ink, ha="center", va="center")


TABLES, LOSSES = "tables.md", "losses.csv"


def publish(atlas: Atlas, folder: Path, out: Path) -> list[Path]:
    """Write the phase diagram, the table of success on the truth and every loss.

    Args:
        atlas: whose summaries they are.
        folder: of the summaries.
        out: folder of what is written.

    Returns:
        The files.

    Raises:
        ValueError: if there is no summary, or summaries may not be combined.
    """
    done = finished(atlas, folder)
    if not done:
        raise InputError(f"no block of atlas {atlas.name!r} has a summary in {folder}")
    found = summaries.points(atlas, done, summaries.read_agreements(folder))
    make_folder(out)
    homes = [home.name for home in atlas.panel.train]
    files = figures.write_figure(
        draw_phases(atlas.name, found, homes, atlas.ratios), out / "phases"
    )
    files.append(replace_file(out / LOSSES, _losses(found)))
    files.append(replace_file(out / TABLES, ("\n".join(_phase_table(found)) + "\n").encode()))
    return files


def _phase_table(found: Sequence[summaries.Point]) -> Iterator[str]:
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


def _losses(found: Sequence[summaries.Point]) -> bytes:
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
        lost = paired_difference(point.at_home, point.on_truth).interval
        rates = (point.at_home.mean(), point.on_truth.mean(), point.recovered.mean())
        numbers = (*rates, lost.estimate, *lost.ends)
        table.writerow(
            [point.home.name, f"{point.ratio:g}", len(point.seeds)]
            + [f"{number:z.4f}" for number in numbers]
        )
    return text.getvalue().encode()
