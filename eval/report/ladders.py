"""Success against one argument of the environment: the step on ladders, another one on sweeps."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

from integ_gym.support.figures import DASHES, SeriesStyle, SeriesStyles
from integ_gym.support.terminal import step

from ..panel.cells import Cell, axes_between, flatten
from ..panel.result import Entry, Panel, Row
from ..scheme_style import styles_of
from ..statistics import Estimate
from .forests import are_close

_LETTER: Final = 0.027  # width of a letter on the page, as a share of the axis

Rungs: TypeAlias = Mapping[str, Mapping[float, Entry]]
"""Scheme to its entries by step, s, from coarse to fine."""


@dataclass(frozen=True)
class Ladder:
    """Success of one row under refinement.

    Attributes:
        row: the row.
        control_period: its own, s; None where it has none.
        fixed: rungs at that control period.
        following: rungs where the control period is the step itself; empty without any.
        truth: the row on the reference, or the limit, at its own control period; or None.
    """

    row: Row
    control_period: float | None
    fixed: Rungs
    following: Rungs
    truth: Entry | None


@dataclass(frozen=True)
class Point:
    """Success at one value; ``x`` is its place in [0, 1] on the axis."""

    x: float
    value: Estimate
    words: str


@dataclass(frozen=True)
class Series:
    """One line; ``aside``: widths of a line by which it is moved, to stay visible."""

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
        truth: success on the reference, or at the limit; None where it is not drawn.
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
        truth_name: what their truth is called.
    """

    title: str
    about: str
    schemes: SeriesStyles
    rows: tuple[tuple[str, tuple[LadderPlot, ...]], ...]
    paired: bool
    truth_name: str = "truth"


def ladder_plots(panel: Panel) -> LadderPlots | None:
    """Plots of all ladders; None if the panel has none."""
    ladders = ladders_of(panel)
    if not ladders:
        return None
    schemes = styles_of(name for one in ladders for name in (*one.fixed, *one.following))
    groups = []
    for one in ladders:
        period = "" if one.control_period is None else f" at {step(one.control_period)} s"
        truth = one.truth.success if one.truth else None
        shown = (
            (f"control period fixed{period}", one.fixed, truth),
            ("control period follows the step", one.following, None),
        )
        plots = tuple(
            _ladder_plot(about, rungs, schemes, at) for about, rungs, at in shown if rungs
        )
        groups.append((panel.label(one.row.name), plots))
    about = "success of the same policies as the step shrinks; finer to the right"
    paired = any(one.following for one in ladders)
    named = panel.yardstick_name
    return LadderPlots("Refinement ladder", about, schemes, tuple(groups), paired, named)


def ladders_of(panel: Panel) -> list[Ladder]:
    """Refinement ladders of the rows that have one.

    Rows that did not learn are left out if others did, and baselines if others are there.
    """
    ladders = [ladder for row in panel.ordered_rows if (ladder := _ladder(panel, row))]
    others = [ladder for ladder in ladders if not ladder.row.baseline]
    learned = [ladder for ladder in others if ladder.row.learned is not False]
    return learned or others or ladders


def _ladder(panel: Panel, row: Row) -> Ladder | None:
    """At the row's own control period, or the one that most columns have."""
    period = row.control_period
    if period is None and panel.columns:
        period = Counter(cell.control_period for cell in panel.columns).most_common(1)[0][0]
    at_period: dict[str, dict[float, Entry]] = {}
    following: dict[str, dict[float, Entry]] = {}
    engines = {"native", *(cell.engine for cell in panel.cells if cell.name in row.shares)}
    for cell in panel.cells:
        entry = panel.entry(row.name, cell.name) if cell.engine in engines else None
        if entry is None or cell.kind in ("varied", "limit"):
            continue
        if are_close(cell.control_period, cell.dt):
            following.setdefault(cell.scheme, {}).setdefault(cell.dt, entry)
        if period is not None and are_close(cell.control_period, period) and not cell.reference:
            at_period.setdefault(cell.scheme, {}).setdefault(cell.dt, entry)
    own, along = (
        {
            scheme: dict(sorted(entries.items(), reverse=True))
            for scheme, entries in schemes.items()
            if len(entries) > 1
        }
        for schemes in (at_period, following)
    )
    if not own and not along:
        return None
    truth = panel.limit_at(period) if panel.truth is None else panel.truth_at(period) or panel.truth
    on_truth = panel.entry(row.name, truth.name) if truth else None
    return Ladder(row, period, own, along, on_truth)


def _ladder_plot(
    about: str, rungs: Rungs, schemes: SeriesStyles, truth: Estimate | None
) -> LadderPlot:
    steps = sorted({dt for entries in rungs.values() for dt in entries}, reverse=True)
    span = math.log(steps[0] / steps[-1])
    places = {dt: math.log(steps[0] / dt) / span for dt in steps}
    order = list(schemes)
    series = []
    for name, entries in rungs.items():
        words = {dt: f"{name}, step {step(dt)} s: success {e.success}" for dt, e in entries.items()}
        points = tuple(Point(places[dt], e.success, words[dt]) for dt, e in entries.items())
        aside = order.index(name) - (len(order) - 1) / 2.0
        series.append(Series(name, schemes[name], aside, points))
    ticks = thin_ticks([(places[dt], step(dt)) for dt in steps], _LETTER)
    return LadderPlot(about, ticks, tuple(series), truth)


def thin_ticks(ticks: Iterable[tuple[float, str]], letter: float) -> tuple[tuple[float, str], ...]:
    """Those of some ticks, in order, whose labels do not touch.

    Args:
        ticks: place in [0, 1] and label.
        letter: width of a letter, as a share of the axis.
    """
    thin: list[tuple[float, str]] = []
    for place, label in ticks:
        if not thin or place - thin[-1][0] >= letter * (1 + 0.5 * len(label + thin[-1][1])):
            thin.append((place, label))
    return tuple(thin)


def sweep_plots(panel: Panel) -> LadderPlots | None:
    """Plots of all sweeps, on the truth and at home; None if the panel has none."""
    rows = [row for row in panel.ordered_rows if not row.baseline]
    rows = [row for row in rows if row.learned is not False] or rows
    cells = {cell.name: cell for cell in panel.cells}
    homes = {row.name: cells.get(row.home or "") for row in rows}
    styles = _row_styles(homes)
    groups = []
    for argument, names in panel.sweeps.items():
        plots = tuple(_sweep_plots(panel, argument, names, homes, styles))
        if plots:
            groups.append((argument, plots))
    if not groups:
        return None
    about = "success of the same policies as one argument of the environment changes"
    paired = any(len(plots) > 1 for _, plots in groups)
    return LadderPlots("Sweeps", about, styles, tuple(groups), paired)


def _sweep_plots(
    panel: Panel,
    argument: str,
    names: Mapping[float, str],
    homes: Mapping[str, Cell | None],
    styles: SeriesStyles,
) -> Iterator[LadderPlot]:
    """On the truth, if there is one, and every row at its own home."""
    values = [*names]
    places = {value: (value - values[0]) / (values[-1] - values[0]) for value in values}
    ticks = tuple((place, f"{value:g}") for value, place in places.items())
    along = ", ".join(filter(None, (argument, panel.units.get(argument))))
    varied = {cell.variation for cell in panel.cells}
    truths = {
        row: panel.truth_at(home.control_period if home else None) for row, home in homes.items()
    }

    def points(row: str, home: Cell) -> Iterator[Point]:
        """Success by value at a discretization; the value that no cell has is undisturbed."""
        own = getattr(home, argument, None)
        for value, place in places.items():
            name = names[value]
            changed = name in varied and not (isinstance(own, float) and are_close(own, value))
            cell = _find_changed_cell(panel, home, argument, value) if changed else home
            entry = cell and panel.entry(row, cell.name)
            if entry:
                words = f"{panel.in_words(row)}, {argument}={value:g}: success {entry.success}"
                yield Point(place, entry.success, words)

    for about, cells in (("on the truth", truths), ("at home", homes)):
        series = []
        for number, (row, place) in enumerate(cells.items()):
            shown = tuple(points(row, place)) if place else ()
            if len(shown) > 1:
                series.append(Series(row, styles[row], number - (len(homes) - 1) / 2.0, shown))
        if series:
            yield LadderPlot(about, ticks, tuple(series), None, along)


def _find_changed_cell(panel: Panel, home: Cell, argument: str, value: float) -> Cell | None:
    """The cell that differs from another in the value of one argument alone."""
    for cell in panel.cells:
        apart = axes_between(home.discretization, cell).values()
        if [one for own in apart for one in flatten(own)] == [(argument, value)]:
            return cell
    return None


def _row_styles(homes: Mapping[str, Cell | None]) -> SeriesStyles:
    """Of rows by their homes: their integrator's, dashed where an earlier row has it already."""
    schemes = {row: row if home is None else home.scheme for row, home in homes.items()}
    of_scheme, styles = styles_of(schemes.values()), dict[str, SeriesStyle]()
    counts: Counter[str] = Counter()
    for row, scheme in schemes.items():
        style, count = of_scheme[scheme], counts[scheme]
        styles[row] = replace(style, dashes=DASHES[count % len(DASHES)]) if count else style
        counts[scheme] += 1
    return styles
