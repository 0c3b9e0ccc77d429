"""Sweeps: success of every row as one constructor argument changes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from integ_gym.support.figures import DASHES, SeriesStyle, SeriesStyles

from ...panel.model.matrix import Cell, Row
from ...panel.model.panel import Panel
from ...panel.specification.cells.sweeps import swept_name
from ...scheme_style import styles_of
from .checks import alike
from .ladders import LadderPlot, LadderPlots, Point, Series


def sweep_plots(panel: Panel) -> LadderPlots | None:
    """Plots of all sweeps, on the truth and at home; None if the panel has none."""
    rows = [row for row in panel.ordered_rows if not row.baseline]
    rows = [row for row in rows if row.learned is not False] or rows
    groups = []
    for sweep in panel.spec.get("sweeps", ()):
        plots = tuple(_plots(panel, sweep, rows))
        if plots:
            groups.append((str(sweep["argument"]), plots))
    if not groups:
        return None
    about = "success of the same policies as one argument of the environment changes"
    paired = any(len(plots) > 1 for _, plots in groups)
    return LadderPlots("Sweeps", about, _styles(panel, rows), tuple(groups), paired)


def _plots(panel: Panel, sweep: Mapping[str, Any], rows: list[Row]) -> Iterator[LadderPlot]:
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
