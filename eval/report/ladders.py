"""Refinement ladders: success of one row as the step shrinks."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, TypeAlias

from integ_gym.support.figures import DASHES, SeriesStyle, SeriesStyles
from integ_gym.support.terminal import step

from ..panel.cells import swept_name
from ..panel.result import Cell, Entry, Estimate, Panel, Row
from ..scheme_style import styles_of
from .forests import alike, close

_LETTER: Final = 0.027  # width of a letter on the page, as a share of the axis


@dataclass(frozen=True)
class Rung:
    """Success at one step of a refinement ladder."""

    dt: float
    entry: Entry


Rungs: TypeAlias = Mapping[str, tuple[Rung, ...]]
"""For every scheme, rungs from coarse to fine."""


@dataclass(frozen=True)
class Ladder:
    """Success of one row under refinement.

    Attributes
    ----------
    fixed
        For every scheme, rungs from coarse to fine at the row's own control period.
    following
        The same where the control period is the step itself; empty where the panel has none.
    truth
        The row on the reference at its own control period, or None.
    """

    row: Row
    control_period: float | None
    fixed: Rungs
    following: Rungs
    truth: Entry | None


@dataclass(frozen=True)
class Point:
    """Success at one step; ``x`` is its place in [0, 1] from the coarsest step to the finest."""

    x: float
    value: Estimate
    words: str


@dataclass(frozen=True)
class Series:
    """One scheme's line; ``aside``: widths of a line by which it is moved, to stay visible."""

    name: str
    style: SeriesStyle
    aside: float
    points: tuple[Point, ...]


@dataclass(frozen=True)
class LadderPlot:
    """One plot of success against the step, equal factors equally far apart, or another argument.

    Attributes:
        about: what happens to the control period, or where it was evaluated.
        ticks: place in [0, 1] and value, as it is written.
        series: one for each scheme, or row.
        truth: success on the reference; None where it is not drawn.
        along: what the axis across is, with its unit.
    """

    about: str
    ticks: tuple[tuple[float, str], ...]
    series: tuple[Series, ...]
    truth: Estimate | None
    along: str = "step, s"


@dataclass(frozen=True)
class LadderPlots:
    """Plots of success against the step, or against another argument, in groups.

    Attributes:
        title, about: what they are.
        schemes: styles of the series in them.
        rows: names of groups, a row's or an argument's, each with its plots.
        paired: whether groups have two plots.
    """

    title: str
    about: str
    schemes: SeriesStyles
    rows: tuple[tuple[str, tuple[LadderPlot, ...]], ...]
    paired: bool


def ladder_plots(panel: Panel) -> LadderPlots | None:
    """Plots of all ladders; None if the panel has none."""
    ladders = ladders_of(panel)
    if not ladders:
        return None
    schemes = styles_of(name for one in ladders for name in (*one.fixed, *one.following))
    rows = tuple((panel.called(ladder.row.name), _plots(ladder, schemes)) for ladder in ladders)
    about = "success of the same policies as the step shrinks; finer to the right"
    paired = any(ladder.following for ladder in ladders)
    return LadderPlots("Refinement ladder", about, schemes, rows, paired)


def _plots(ladder: Ladder, schemes: SeriesStyles) -> tuple[LadderPlot, ...]:
    truth = None if ladder.truth is None else ladder.truth.success
    period = "" if ladder.control_period is None else f" at {step(ladder.control_period)} s"
    plots = []
    if ladder.fixed:
        plots.append(_plot(f"control period fixed{period}", ladder.fixed, schemes, truth))
    if ladder.following:
        plots.append(_plot("control period follows the step", ladder.following, schemes, None))
    return tuple(plots)


def _plot(about: str, rungs: Rungs, schemes: SeriesStyles, truth: Estimate | None) -> LadderPlot:
    steps = sorted({rung.dt for line in rungs.values() for rung in line}, reverse=True)
    span = math.log(steps[0] / steps[-1])
    places = {dt: math.log(steps[0] / dt) / span for dt in steps}
    ticks = thinned([(places[dt], step(dt)) for dt in steps], _LETTER)
    order = list(schemes)
    series = []
    for name, line in rungs.items():
        points = tuple(
            Point(
                places[rung.dt],
                rung.entry.success,
                f"{name}, step {step(rung.dt)} s: success {rung.entry.success}",
            )
            for rung in line
        )
        aside = order.index(name) - (len(order) - 1) / 2.0
        series.append(Series(name, schemes[name], aside, points))
    return LadderPlot(about, ticks, tuple(series), truth)


def thinned(ticks: Iterable[tuple[float, str]], letter: float) -> tuple[tuple[float, str], ...]:
    """Those of some ticks, in order, whose labels do not touch.

    Args:
        ticks: place in [0, 1] and label.
        letter: width of a letter, as a share of the axis.
    """
    kept: list[tuple[float, str]] = []
    for place, label in ticks:
        if not kept or place - kept[-1][0] >= letter * (1 + 0.5 * len(label + kept[-1][1])):
            kept.append((place, label))
    return tuple(kept)


def ladders_of(panel: Panel) -> tuple[Ladder, ...]:
    """Refinement ladders of the rows that have one.

    Rows that did not learn are left out if others did, and baselines if others are there.
    """
    ladders = [ladder for row in panel.ordered_rows if (ladder := _ladder(panel, row))]
    others = [ladder for ladder in ladders if not ladder.row.baseline]
    learned = [ladder for ladder in others if ladder.row.learned is not False]
    return tuple(learned or others or ladders)


def _ladder(panel: Panel, row: Row) -> Ladder | None:
    period = row.control_period if row.control_period is not None else _usual_period(panel)
    fixed_period: dict[str, list[Rung]] = {}
    following: dict[str, list[Rung]] = {}
    engines = {"native", *(cell.engine for cell in panel.cells if cell.name in row.shares)}
    for cell in panel.cells:
        entry = panel.entry(row.name, cell.name) if cell.engine in engines else None
        if entry is None or not cell.plain:
            continue
        if close(cell.control_period, cell.dt):
            following.setdefault(cell.scheme, []).append(Rung(cell.dt, entry))
        if period is not None and close(cell.control_period, period) and not cell.reference:
            fixed_period.setdefault(cell.scheme, []).append(Rung(cell.dt, entry))
    at_fixed, along = _ladder_rungs(fixed_period), _ladder_rungs(following)
    if not at_fixed and not along:
        return None
    same = (c for c in panel.cells if c.reference and period and close(c.control_period, period))
    truth = next(same, panel.truth)
    on_truth = None if truth is None else panel.entry(row.name, truth.name)
    return Ladder(row, period, at_fixed, along, on_truth)


def _usual_period(panel: Panel) -> float | None:
    periods = Counter(cell.control_period for cell in panel.columns)
    return periods.most_common(1)[0][0] if periods else None


def _ladder_rungs(found: Mapping[str, list[Rung]]) -> dict[str, tuple[Rung, ...]]:
    """Ladders of at least two steps, each from coarse to fine."""
    ladders = {}
    for scheme, rungs in found.items():
        unique = {rung.dt: rung for rung in reversed(rungs)}
        if len(unique) > 1:
            ladders[scheme] = tuple(unique[dt] for dt in sorted(unique, reverse=True))
    return ladders


def sweep_plots(panel: Panel) -> LadderPlots | None:
    """Plots of all sweeps, on the truth and at home; None if the panel has none."""
    rows = [row for row in panel.ordered_rows if not row.baseline]
    rows = [row for row in rows if row.learned is not False] or rows
    groups = []
    for sweep in panel.spec.get("sweeps", ()):
        plots = tuple(_sweep_plots(panel, sweep, rows))
        if plots:
            groups.append((str(sweep["argument"]), plots))
    if not groups:
        return None
    about = "success of the same policies as one argument of the environment changes"
    paired = any(len(plots) > 1 for _, plots in groups)
    return LadderPlots("Sweeps", about, _styles(panel, rows), tuple(groups), paired)


def _sweep_plots(panel: Panel, sweep: Mapping[str, Any], rows: list[Row]) -> Iterator[LadderPlot]:
    """On the truth, if there is one, and every row at its own home."""
    argument = str(sweep["argument"])
    places: list[tuple[str, dict[str, Cell | None]]] = [
        ("at home", {row.name: _home(panel, row) for row in rows})
    ]
    if panel.truth is not None:
        places.insert(0, ("on the truth", {row.name: panel.truth for row in rows}))
    values = [float(value) for value in sweep["values"]]
    ticks = tuple((_place(values, value), f"{value:g}") for value in values)
    styles, along = _styles(panel, rows), ", ".join(filter(None, (argument, sweep["unit"])))
    for about, cells in places:
        series = []
        for number, row in enumerate(rows):
            points = tuple(_points(panel, argument, values, row, cells[row.name]))
            if len(points) > 1:
                aside = number - (len(rows) - 1) / 2.0
                series.append(Series(row.name, styles[row.name], aside, points))
        if series:
            yield LadderPlot(about, ticks, tuple(series), None, along)


def _place(values: list[float], value: float) -> float:
    return (value - values[0]) / (values[-1] - values[0])


def _points(
    panel: Panel, argument: str, values: list[float], row: Row, home: Cell | None
) -> Iterator[Point]:
    """A row's success by value at a discretization; the value that no change has is undisturbed."""
    if home is None:
        return
    changed = {cell.perturbation for cell in panel.cells}
    here = {c.perturbation: c for c in panel.cells if c.perturbation and alike(c, home)}
    for value in values:
        name = swept_name(argument, value)
        cell = here.get(name) if name in changed else home
        entry = None if cell is None else panel.entry(row.name, cell.name)
        if entry is not None:
            words = f"{row.name}, {name}: success {entry.success}"
            yield Point(_place(values, value), entry.success, words)


def _home(panel: Panel, row: Row) -> Cell | None:
    """Where a row was trained; None of a mixture."""
    return None if row.mixed else panel.cell(next(iter(row.shares)))


def _styles(panel: Panel, rows: list[Row]) -> SeriesStyles:
    """Of rows: their integrator's, dashed where an earlier row has it already."""
    schemes: dict[str, str] = {}
    for row in rows:
        home = _home(panel, row)
        schemes[row.name] = row.name if home is None else home.scheme
    of_scheme, found = styles_of(schemes.values()), dict[str, SeriesStyle]()
    taken: dict[str, int] = {}
    for name, scheme in schemes.items():
        count = taken[scheme] = taken.get(scheme, -1) + 1
        style = of_scheme[scheme]
        found[name] = style if not count else replace(style, dashes=DASHES[count % len(DASHES)])
    return found
