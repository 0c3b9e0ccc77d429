"""A panel's mixtures: do they hold where single discretizations do not, at what cost."""

from __future__ import annotations

from dataclasses import dataclass

from integ_gym.eval.formatting import NONE
from integ_gym.eval.panel_model import Entry, Estimate, Panel, Row, TrainingCost
from integ_gym.eval.panel_model import Remedy as Found


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
        return min((rival.entry.success.estimate for rival in self.rivals), default=1.0)

    @property
    def highest(self) -> float:
        """Highest success of the rivals; 1 without any."""
        return max((rival.entry.success.estimate for rival in self.rivals), default=1.0)


@dataclass(frozen=True)
class Cost:
    """Training decisions of one row until its training episodes succeeded.

    Attributes:
        row: the row.
        training: what it took.
        truth: what the row does on the reference in the end.
    """

    row: Row
    training: TrainingCost
    truth: Estimate | None

    @property
    def median(self) -> str:
        """The median in words."""
        median = self.training.median
        known = None if median is None else median.estimate
        return "not reached" if known is None else f"{round(known):,}"

    @property
    def interval(self) -> str:
        """The interval in words."""
        median = self.training.median
        if median is None or median.low is None:
            return NONE
        end = "or more" if median.high is None else f"to {round(median.high):,}"
        return f"{round(median.low):,} {end}"


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
        return ", ".join(self.row.shares)


def remedies_of(panel: Panel) -> tuple[Remedy, ...]:
    """The panel's mixtures, in order."""
    return tuple(
        Remedy(panel.row(found.row), found.summary, _lines(panel, found))
        for found in panel.remedies
    )


def _lines(panel: Panel, found: Found) -> tuple[Line, ...]:
    lines = []
    for cell in found.cells:
        lost = {one.row: one.difference for one in cell.lost}
        entries = [panel.entry(name, cell.cell) for name in found.singles]
        rivals = [Rival(e, e.row in lost, lost.get(e.row)) for e in entries if e is not None]
        own = panel.entry(found.row, cell.cell)
        if own is not None:
            lines.append(Line(own, cell.member, cell.solved, tuple(rivals)))
    return tuple(lines)


def costs_of(panel: Panel) -> tuple[Cost, ...]:
    """Training cost of every trained row that the panel tells it of."""
    costs = []
    for row in panel.ordered_rows:
        if row.name in panel.training_costs:
            truth = panel.on_truth(row.name)
            success = None if truth is None else truth.success
            costs.append(Cost(row, panel.training_costs[row.name], success))
    return tuple(costs)


def line_words(line: Line) -> str:
    """A line in words, for tooltips and screen readers."""
    parts = [f"{line.entry.cell}: {line.entry.row} {line.entry.success}"]
    for rival in line.rivals:
        words = f"{rival.entry.row} {rival.entry.success}"
        if rival.difference is not None:
            words += f", {line.entry.row} minus it {rival.difference}"
        parts.append(words)
    return "; ".join(parts)
