"""Checks: success before and after a change of the plant or its delays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from integ_gym.eval.report_data.panel import Panel
from integ_gym.eval.report_data.parts import Entry, Row, close


@dataclass(frozen=True)
class Check:
    """One row before and after a change of the plant or its delays."""

    before: Entry | None
    after: Entry


def checks_of(panel: Panel) -> Mapping[str, tuple[Check, ...]]:
    """For every perturbation, the rows that met it; those that learned, if any did."""
    learned = [row for row in panel.ordered_rows if row.learned is not False]
    return _checks(panel, learned) or _checks(panel, panel.ordered_rows)


def _checks(panel: Panel, rows: Sequence[Row]) -> Mapping[str, tuple[Check, ...]]:
    checks: dict[str, list[Check]] = {}
    for row in rows:
        for cell in panel.cells:
            after = panel.entry(row, cell)
            if after is not None and after.success is not None and not cell.plain:
                label = cell.perturbation or cell.name
                checks.setdefault(label, []).append(Check(_before(panel, after), after))
    return {label: tuple(found) for label, found in checks.items()}


def _before(panel: Panel, after: Entry) -> Entry | None:
    """The same row and discretization without the perturbation."""
    cell = after.cell
    for other in panel.cells:
        same = (other.engine, other.integrator) == (cell.engine, cell.integrator)
        steps = close(other.dt, cell.dt) and close(other.control_period, cell.control_period)
        if other.plain and same and steps:
            return panel.entry(after.row, other)
    return None
