"""A panel's mixtures: do they hold where single discretizations do not, at what cost."""

from __future__ import annotations

from dataclasses import dataclass

from integ_gym.support.terminal import NONE, fixed

from ...panel.model.conclusions import Remedy, RemedyCell, TrainingCost
from ...panel.model.matrix import Entry, Row
from ...panel.model.panel import Panel
from ...panel.model.part import Estimate
from .axes import RATE_AXIS
from .forest import Block, Forest, Line, Mark


@dataclass(frozen=True)
class Mixture:
    """A mixture held against single discretizations.

    Attributes:
        row: trained on the mixture.
        summary: what came out, in sentences.
        harmful: cells in which a single discretization costs success, the worst first.
        others: the rest, in column order.
    """

    row: Row
    summary: str
    harmful: tuple[Line, ...]
    others: tuple[Line, ...]

    @property
    def members(self) -> str:
        """The discretizations that it was trained on, in words."""
        return ", ".join(self.row.shares)


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


def mixtures_of(panel: Panel) -> tuple[Mixture, ...]:
    """The panel's mixtures, in order."""
    return tuple(_mixture(panel, remedy) for remedy in panel.remedies)


def remedy_forest(panel: Panel) -> Forest | None:
    """Every discretization in which single ones lose, by mixture; None without any."""
    blocks = [
        Block(f"{found.row.name}: {found.members}", found.harmful)
        for found in mixtures_of(panel)
        if found.harmful
    ]
    if not blocks:
        return None
    about = (
        "success; dot: mixture, with its interval; rings: single ones, red where they lose > 0.2"
    )
    return Forest("A remedy: training on a mixture", about, "success", RATE_AXIS, tuple(blocks))


def _mixture(panel: Panel, remedy: Remedy) -> Mixture:
    harmful, others = [], []
    for cell in remedy.cells:
        own = panel.entry(remedy.row, cell.cell)
        found = [panel.entry(single, cell.cell) for single in remedy.singles]
        rivals = sorted((e for e in found if e is not None), key=lambda e: e.success.estimate)
        if own is None:
            continue
        line = _line(own, rivals, cell)
        if cell.solved and cell.lost and rivals:
            harmful.append((rivals[0].success.estimate, line))
        else:
            others.append(line)
    harmful.sort(key=lambda pair: pair[0])
    row = panel.row(remedy.row)
    return Mixture(row, remedy.summary, tuple(line for _, line in harmful), tuple(others))


def _line(own: Entry, rivals: list[Entry], cell: RemedyCell) -> Line:
    """A mixture in one cell beside rows of a single discretization, the lowest first."""
    lost = {one.row: one.difference for one in cell.lost}
    words, marks = [f"{own.cell}: {own.row} {own.success}"], []
    for rival in rivals:
        alone = Estimate(rival.success.estimate)
        marks.append(Mark(alone, "fails" if rival.row in lost else "soft", False, -0.35))
        less = f", {own.row} minus it {lost[rival.row]}" if rival.row in lost else ""
        words.append(f"{rival.row} {rival.success}{less}")
    rates = [fixed(rival.success.estimate) for rival in rivals]
    notes = ["trained there"] if cell.member else []
    notes += [] if cell.solved else ["nobody solves it"]
    return Line(
        "",
        own.cell,
        (own.row, own.cell),
        (*marks, Mark(own.success, "accent", down=0.35)),
        fixed(own.success.estimate),
        f"others {rates[0]} to {rates[-1]}" if rates else "no other row learned",
        "; ".join(words),
        ", ".join(notes),
    )


def costs_of(panel: Panel) -> tuple[Cost, ...]:
    """Training cost of every trained row that the panel tells it of."""
    costs = []
    for row in panel.ordered_rows:
        if row.name in panel.training_costs:
            truth = panel.on_truth(row.name)
            success = None if truth is None else truth.success
            costs.append(Cost(row, panel.training_costs[row.name], success))
    return tuple(costs)
