"""Checks: success before and after a change of the plant or its delays."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from integ_gym.support.terminal import NONE, fixed

from ...panel.model.matrix import Cell, Entry, Row
from ...panel.model.panel import Panel
from ...panel.specification.cells.sweeps import swept_name
from .axes import RATE_AXIS
from .forest import Block, Forest, Line, Mark


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
    swept = {
        swept_name(sweep["argument"], value)
        for sweep in panel.spec.get("sweeps", ())
        for value in sweep["values"]
    }
    for row in rows:
        for cell in panel.cells:
            after = panel.entry(row.name, cell.name)
            if after is not None and not cell.plain and cell.perturbation not in swept:
                label = cell.perturbation or cell.name
                checks.setdefault(label, []).append(Check(_before(panel, after), after))
    return {label: tuple(found) for label, found in checks.items()}


def _before(panel: Panel, after: Entry) -> Entry | None:
    """The same row and discretization without the perturbation."""
    cell = panel.cell(after.cell)
    same = (other for other in panel.cells if other.plain and alike(other, cell))
    return next((panel.entry(after.row, other.name) for other in same), None)


def check_forest(panel: Panel) -> Forest | None:
    """Success before and after every change of the plant or its delays; None without any."""
    blocks = [Block(label, [_line(c) for c in found]) for label, found in checks_of(panel).items()]
    if not blocks:
        return None
    about = "success with its interval over seeds: ring as specified, dot with the change; the loss"
    return Forest("Perturbations and latency", about, "success", RATE_AXIS, tuple(blocks))


def _line(check: Check) -> Line:
    after = check.after.success
    before = None if check.before is None else check.before.success
    was, marks = NONE, [Mark(after, "accent", down=0.35)]
    if before is not None:
        was = fixed(before.estimate)
        marks.insert(0, Mark(before, "soft", filled=False, down=-0.35))
    loss = None if before is None else before.estimate - after.estimate
    return Line(
        check.after.row,
        check.after.cell if check.before is None else check.before.cell,
        (check.after.row, check.after.cell),
        tuple(marks),
        fixed(loss, sign=True),
        f"{was} → {fixed(after.estimate)}",
        f"{check.after.row}: success {before or 'not known'} before, {after} on {check.after.cell}",
    )


def alike(one: Cell, other: Cell) -> bool:
    """Whether two cells are of the same discretization."""
    names = (one.engine, one.integrator) == (other.engine, other.integrator)
    return names and close(one.dt, other.dt) and close(one.control_period, other.control_period)


def close(one: float, other: float) -> bool:
    """Whether two times, s, are the same up to rounding."""
    return math.isclose(one, other, rel_tol=1e-9)
