"""Refinement ladders: success of one row as the step shrinks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from integ_gym.eval.panel_model import Entry, Panel, Row
from integ_gym.eval.report_data.checks import close


@dataclass(frozen=True)
class Rung:
    """Success at one step of a refinement ladder."""

    dt: float
    entry: Entry


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
    fixed: Mapping[str, tuple[Rung, ...]]
    following: Mapping[str, tuple[Rung, ...]]
    truth: Entry | None


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
