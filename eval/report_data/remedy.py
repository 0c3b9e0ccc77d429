"""A panel's mixtures: do they hold where single discretizations do not, at what cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from integ_gym.eval.formatting import NONE, finite
from integ_gym.eval.report_data.estimate import Estimate, estimate
from integ_gym.eval.report_data.panel import Panel
from integ_gym.eval.report_data.parts import Cell, Entry, Json, Row


@dataclass(frozen=True)
class Rival:
    """One row of a single discretization in one cell.

    Attributes:
        entry: what it did there.
        lost: whether its loss there is estimated above the margin.
        difference: success of the mixture minus its own, where it lost.
    """

    entry: Entry
    lost: bool
    difference: Estimate | None


@dataclass(frozen=True)
class Line:
    """One evaluation cell: the mixture beside all others.

    Attributes:
        entry: what the mixture did there.
        member: whether it was trained there.
        solved: whether anybody solves the cell.
        rivals: rows of a single discretization, home included.
    """

    entry: Entry
    member: bool
    solved: bool
    rivals: tuple[Rival, ...]

    @property
    def harmful(self) -> bool:
        """Whether somebody loses there what could be kept."""
        return self.solved and any(rival.lost for rival in self.rivals)

    @property
    def lowest(self) -> float:
        """Lowest success of the rivals; 1 without any."""
        return min((success_of(rival.entry) for rival in self.rivals), default=1.0)

    @property
    def highest(self) -> float:
        """Highest success of the rivals; 1 without any."""
        return max((success_of(rival.entry) for rival in self.rivals), default=1.0)


@dataclass(frozen=True)
class Cost:
    """Training decisions of one row until its training episodes succeeded.

    Attributes:
        row: the row.
        steps: median over seeds; None where it was not reached.
        low, high: ends of its interval; None where not reached.
        level: of the interval.
        reached: seeds that reached it.
        window: training episodes that are averaged.
        rate: share of them that must succeed.
        truth: what the row does on the reference in the end.
    """

    row: Row
    steps: float | None
    low: float | None
    high: float | None
    level: float | None
    reached: int
    window: int
    rate: float
    truth: Estimate | None

    @property
    def median(self) -> str:
        """The median in words."""
        return "not reached" if self.steps is None else f"{round(self.steps):,}"

    @property
    def interval(self) -> str:
        """The interval in words."""
        if self.low is None:
            return NONE
        end = "or more" if self.high is None else f"to {round(self.high):,}"
        return f"{round(self.low):,} {end}"


@dataclass(frozen=True)
class Remedy:
    """A mixture held against single discretizations."""

    row: Row
    summary: str
    lines: tuple[Line, ...]

    @property
    def harmful(self) -> tuple[Line, ...]:
        """Cells in which a single discretization costs success, the worst first."""
        found = [line for line in self.lines if line.harmful]
        return tuple(sorted(found, key=lambda line: line.lowest))

    @property
    def others(self) -> tuple[Line, ...]:
        """The rest, in column order."""
        return tuple(line for line in self.lines if not line.harmful)

    @property
    def members(self) -> str:
        """The discretizations that it was trained on, in words."""
        return ", ".join(self.row.homes)


def success_of(entry: Entry) -> float:
    """Success rate of an entry; 0 where it is not known."""
    return entry.success.estimate if entry.success is not None else 0.0


def remedies_of(panel: Panel) -> tuple[Remedy, ...]:
    """The panel's mixtures, in order."""
    rows = {row.name: row for row in panel.rows}
    found = []
    for raw in panel.items("remedies"):
        row = rows.get(str(raw.get("row")))
        if row is not None:
            singles = [rows[str(name)] for name in raw.get("singles") or [] if str(name) in rows]
            lines = _lines(panel, row, singles, raw.get("cells") or [])
            found.append(Remedy(row, str(raw.get("summary") or ""), lines))
    return tuple(found)


def _lines(
    panel: Panel, row: Row, singles: Sequence[Row], cells: Sequence[Json]
) -> tuple[Line, ...]:
    by_name: Mapping[str, Cell] = {cell.name: cell for cell in panel.cells}
    lines = []
    for raw in cells:
        cell = by_name.get(str(raw.get("cell")))
        entry = panel.entry(row, cell)
        if entry is not None:
            lost = {str(one.get("row")): one for one in raw.get("lost") or []}
            pairs = [(name, panel.entry(name, cell)) for name in singles]
            rivals = tuple(
                Rival(
                    other,
                    single.name in lost,
                    estimate(lost.get(single.name, {}).get("difference")),
                )
                for single, other in pairs
                if other is not None
            )
            member, solved = bool(raw.get("member")), bool(raw.get("solved"))
            lines.append(Line(entry, member, solved, rivals))
    return tuple(lines)


def costs_of(panel: Panel) -> tuple[Cost, ...]:
    """Training cost of every trained row that the panel tells it of."""
    told = panel.mapping("training_costs")
    costs = []
    for row in panel.ordered_rows:
        raw = told.get(row.name)
        if isinstance(raw, Mapping):
            costs.append(_cost(panel, row, raw))
    return tuple(costs)


def _cost(panel: Panel, row: Row, raw: Json) -> Cost:
    median: Any = raw.get("median") or {}
    steps, low, high, level = (finite(median.get(n)) for n in ("estimate", "low", "high", "level"))
    truth = panel.entry(row, panel.truth)
    return Cost(
        row,
        steps,
        low,
        high,
        level,
        int(finite(raw.get("reached")) or 0),
        int(finite(raw.get("window")) or 0),
        finite(raw.get("rate")) or 0.0,
        None if truth is None else truth.success,
    )


def line_words(line: Line) -> str:
    """A line in words, for tooltips and screen readers."""
    parts = [f"{line.entry.cell.name}: {line.entry.row.name} {line.entry.success}"]
    for rival in line.rivals:
        words = f"{rival.entry.row.name} {rival.entry.success}"
        if rival.difference is not None:
            words += f", {line.entry.row.name} minus it {rival.difference}"
        parts.append(words)
    return "; ".join(parts)
