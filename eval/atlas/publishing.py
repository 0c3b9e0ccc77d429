"""An atlas's figures, tables and law, from its summaries alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from integ_gym.support import NONE, fixed, make_folder, percent, replace_file, write_figure

from ..statistics import draws_for, rate_interval
from .agreement import noted_in
from .figures import draw_losses, draw_phases
from .law import CANDIDATES, GUESSES, LEVEL, Trial, fit, telling, trial
from .points import Point, points
from .predicting import LAW, Law
from .running import finished
from .specification import Atlas

TABLES = "tables.md"


@dataclass(frozen=True)
class Published:
    """What was written, and what it says.

    Attributes:
        files: written.
        law: fitted; None where there is nothing to fit.
        trials: every candidate and guess on the limits that were held out, the chosen first.
    """

    files: tuple[Path, ...]
    law: Law | None
    trials: tuple[Trial, ...]


def publish(atlas: Atlas, summaries: Path, out: Path) -> Published:
    """Write phase diagram, losses, tables and law.

    The number that the law is made of is the one whose curve predicts each limit of those that may
    be seen best from the others; limits that are held out have no part in it.

    Args:
        atlas: whose summaries they are.
        summaries: their folder.
        out: folder of what is written.

    Raises:
        ValueError: if there is no summary, or summaries may not be combined.
    """
    done = finished(atlas, summaries)
    if not done:
        raise ValueError(f"no block of atlas {atlas.name!r} has a summary in {summaries}")
    found = points(atlas, done, noted_in(summaries))
    make_folder(out)
    homes = [home.name for home in atlas.panel.train]
    files = write_figure(draw_phases(atlas.name, found, homes, atlas.ratios), out / "phases")
    seen = [point for point in found if point.ratio not in atlas.held_out]
    curves = [fit(name, seen) for name in (*CANDIDATES, *GUESSES)]
    chosen = min(curves[: len(CANDIDATES)], key=lambda curve: curve.seen_error)
    files += write_figure(draw_losses(atlas.name, found, atlas.held_out, chosen), out / "losses")
    ordered = [chosen, *(curve for curve in curves if curve is not chosen)]
    held_out = telling([point for point in found if point.ratio in atlas.held_out])
    trials = tuple(trial(curve, held_out) for curve in ordered) if held_out else ()
    margins = [point.ratio for point in seen]
    seals = tuple(summary.origin.seal for _, summary in done)
    law = Law(atlas.name, chosen, (min(margins), max(margins)), seals)
    told = "\n".join([*_phase_table(found), "", *_trial_table(trials)])
    files.append(replace_file(out / TABLES, (told + "\n").encode()))
    files.append(replace_file(out / LAW, msgspec.json.format(msgspec.json.encode(law)) + b"\n"))
    return Published(tuple(files), law, trials)


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


def _trial_table(trials: Sequence[Trial]) -> Iterator[str]:
    """Errors on the limits that were held out, as Markdown."""
    yield "| number | error on held-out limits | 95 % interval | error on seen limits | covered |"
    yield "|---|---|---|---|---|"
    for one in trials:
        interval = f"{fixed(one.low, 3)} to {fixed(one.high, 3)}"
        yield (
            f"| {one.number} | {fixed(one.error, 3)} | {interval} | {fixed(one.seen_error, 3)} | "
            f"{percent(one.covered)} of {one.points} (wanted {percent(LEVEL)}) |"
        )
