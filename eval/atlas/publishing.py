"""An atlas's figures, tables and law, from its summaries alone."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from integ_gym.support import (
    NONE,
    fixed,
    make_folder,
    percent,
    replace_file,
    write_figure,
)

from ..statistics import draws_for, rate_interval
from .figures import draw_losses, draw_phases
from .numbers import CANDIDATES, GUESSES
from .prediction import LAW, QUIET, Law, Trial, errors_of, fit, law, off_by_chance, telling, trials
from .running import finished
from .specification import Atlas
from .summaries import Point, noted_in, points

TABLES, LOSSES = "tables.md", "losses.csv"


@dataclass(frozen=True)
class Published:
    """What was written, and what it says.

    Attributes:
        files: written.
        law: fitted, or the package's own where no limit may be seen.
        trials: every candidate and guess on the limits that were held out, the chosen first; none
            where nothing is held out, or nothing can be predicted.
    """

    files: tuple[Path, ...]
    law: Law
    trials: tuple[Trial, ...]


def publish(atlas: Atlas, summaries: Path, out: Path) -> Published:
    """Write phase diagram, losses as figure and table, tables and law.

    The number that the law is made of is the one that the atlas states, or else the one whose curve
    predicts each limit of those that may be seen best from the others; limits that are held out
    have no part in it. Where all are, the law that comes with the package is held against them.

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
    seals = tuple(summary.origin.seal for _, summary in done)
    own = set(atlas.ratios) > set(atlas.held_out)
    if own and not seen:
        raise ValueError(f"no limit of atlas {atlas.name!r} that a law may be fitted to was run")
    known = _fitted(atlas, seen, seals) if own else law()
    if own:
        content = msgspec.json.format(msgspec.json.encode(known)) + b"\n"
        files.append(replace_file(out / LAW, content))
    tried: tuple[Trial, ...] = ()
    if learned := telling(found):
        drawn = draw_losses(atlas.name, found, atlas.held_out, known.curve)
        files += write_figure(drawn, out / "losses")
        files.append(replace_file(out / LOSSES, _losses(learned, known, atlas.held_out)))
    if held_out := telling([point for point in found if point.ratio in atlas.held_out]):
        tried = trials(known.curves, held_out)
    told = [*_phase_table(found)]
    if tried:
        told += ["", *_trial_table(tried, "" if own else f" of {known.atlas}")]
        told += ["", *_by_limit(known, held_out)]
    files.append(replace_file(out / TABLES, ("\n".join(told) + "\n").encode()))
    return Published(tuple(files), known, tried)


def _fitted(atlas: Atlas, seen: Sequence[Point], seals: tuple[str, ...]) -> Law:
    """Every candidate's and guess's curve, that of the chosen number first."""
    curves = {number: fit(number, seen) for number in (*CANDIDATES, *GUESSES)}
    chosen = atlas.number or min(CANDIDATES, key=lambda number: curves[number].seen_error)
    ordered = (curves.pop(chosen), *curves.values())
    margins = [point.ratio for point in seen]
    ratios = [point.known.critical_ratio for point in telling(seen)]
    return Law(
        atlas.name, atlas.panel.env_id, ordered, (min(margins), max(margins)),
        (min(ratios), max(ratios)), seals,
    )  # fmt: skip


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


def _trial_table(tried: Sequence[Trial], whose: str) -> Iterator[str]:
    """Errors on the limits that were held out, and on those of the fit and whose they are."""
    first = tried[0]
    seen = f"error on seen limits{whose}"
    more = f"more than by {first.number}"
    yield f"| number | error on held-out limits | {more} | {seen} | covered | with chance |"
    yield "|---|---|---|---|---|---|"
    for one in tried:
        beside = NONE if one is first else _with_interval(one.more, one.more_low, one.more_high)
        yield (
            f"| {one.number} | {_with_interval(one.error, one.low, one.high)} | {beside} | "
            f"{fixed(one.seen_error, 3)} | "
            f"{percent(one.covered)} of {one.points} | {percent(one.with_chance)} |"
        )


def _by_limit(known: Law, held_out: Sequence[Point]) -> Iterator[str]:
    """Mean errors at each limit that was held out, and where the numerics do something."""
    ratios = np.array([point.ratio for point in held_out])
    groups = {f"{ratio:g}": ratios == ratio for ratio in np.unique(ratios)}
    driven = np.array([point.known.force > QUIET for point in held_out])
    if driven.any():
        groups[f"force above {QUIET:g}"] = driven
    yield f"| error at | {' | '.join(groups)} |"
    yield "|---" * (len(groups) + 1) + "|"
    for curve in known.curves:
        errors = errors_of(curve, held_out)
        means = (fixed(float(errors[group].mean()), 3) for group in groups.values())
        yield f"| {curve.number} | {' | '.join(means)} |"
    yield f"| *losses* | {' | '.join(str(group.sum()) for group in groups.values())} |"


def _losses(learned: Sequence[Point], known: Law, held_out: Sequence[float]) -> bytes:
    """Every loss, what was known before training and what the law expects, as CSV."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(
        ["trained on", "limit over critical", "held out", "seeds", "success at home",
         "success on the truth", "within twice the time", "loss", "off by chance", "expected loss",
         "reactive force", "power", "time to spare", "critical ratio"]
    )  # fmt: skip
    for point in learned:
        own = point.known
        rates = (point.at_home, point.on_truth, point.recovered)
        numbers = (
            *(rate.mean() for rate in rates), point.loss, off_by_chance(point), known.curve(own),
            own.reactive_force, own.power, own.time_to_spare, own.critical_ratio,
        )  # fmt: skip
        table.writerow(
            [point.home.name, f"{point.ratio:g}", point.ratio in held_out, len(point.seeds)]
            + [f"{number:z.4f}" for number in numbers]
        )
    return text.getvalue().encode()


def _with_interval(value: float, low: float, high: float) -> str:
    return f"{fixed(value, 3)} ({fixed(low, 3)} to {fixed(high, 3)})"
