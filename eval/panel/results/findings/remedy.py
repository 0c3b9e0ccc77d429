"""Whether policies trained on a mixture hold where those of a single discretization do not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from integ_gym.support.terminal import percent

from ....statistics import unpaired_difference
from ....verdict import FAIL_MARGIN, UNSOLVED, Loss
from ...model.conclusions import Remedy, RemedyCell, RemedyLoss
from ...model.part import Estimate
from ..layout import PanelLayout
from ..matrix import Matrix

Losses = Mapping[tuple[str, str], Loss]
"""By row and cell."""


def remedies(layout: PanelLayout, matrix: Matrix, losses: Losses) -> tuple[Remedy, ...]:
    """One entry per mixture: its loss in every column, beside that of single discretizations.

    Only rows of a single discretization that learned are held against it. In every column
    ``lost`` lists those among them, trained elsewhere, whose overfitting is estimated above 0.2.
    Everything here is exploratory.
    """
    singles = [
        row.name
        for row in layout.rows
        if row.kind == "trained" and row.home is not None and matrix.learned(row.name)
    ]
    mixtures = [row.name for row in layout.rows if row.kind == "trained" and len(row.shares) > 1]
    return tuple(_remedy(layout, matrix, losses, mixture, singles) for mixture in mixtures)


def _remedy(
    layout: PanelLayout, matrix: Matrix, losses: Losses, mixture: str, singles: Sequence[str]
) -> Remedy:
    assert layout.reference is not None
    cells = tuple(_cell(matrix, losses, mixture, singles, cell) for cell in layout.columns())
    truth = {row: float(matrix.rates(row, layout.reference).mean()) for row in (mixture, *singles)}
    summary = (
        [*_losses(mixture, cells), *_on_truth(mixture, truth)]
        if matrix.learned(mixture)
        else [f"Policies trained on {mixture} did not learn, so they are no remedy here."]
    )
    return Remedy(row=mixture, singles=tuple(singles), cells=cells, summary=" ".join(summary))


def _cell(
    matrix: Matrix, losses: Losses, mixture: str, singles: Sequence[str], cell: str
) -> RemedyCell:
    lost = [
        row
        for row in singles
        if matrix.rows[row].home != cell and losses[row, cell].overfitting.estimate > FAIL_MARGIN
    ]
    return RemedyCell(
        cell=cell,
        member=cell in matrix.rows[mixture].shares,
        solved=any(bool(matrix.rates(row, cell).mean() >= UNSOLVED) for row in matrix.rows),
        overfitting=Estimate.of(losses[mixture, cell].overfitting),
        lost=tuple(_lost(matrix, losses, mixture, row, cell) for row in lost),
    )


def _lost(matrix: Matrix, losses: Losses, mixture: str, single: str, cell: str) -> RemedyLoss:
    """A row's loss, and success of the mixture minus its own."""
    better = unpaired_difference(matrix.rates(mixture, cell), matrix.rates(single, cell))
    return RemedyLoss(
        row=single,
        overfitting=Estimate.of(losses[single, cell].overfitting),
        difference=Estimate.of(better.interval),
    )


def _losses(mixture: str, cells: Sequence[RemedyCell]) -> list[str]:
    """How many discretizations cost single-discretization policies success, and the mixture."""
    solved = [cell for cell in cells if cell.solved]
    harmful = [cell for cell in solved if cell.lost]
    if not harmful:
        return [
            f"No policy of a single discretization that learned loses more than {FAIL_MARGIN} "
            f"by overfitting anywhere, so there is nothing for {mixture} to remedy."
        ]
    kept = [cell for cell in harmful if cell.overfitting.estimate <= FAIL_MARGIN]
    own = sum(cell.member for cell in kept)
    lost = [cell.cell for cell in harmful if cell not in kept]
    trained = f", {own} of which they were trained in" if own else ""
    rest = f"; they lose more in {', '.join(lost)}" if lost else ""
    return [
        f"In {len(harmful)} of the {len(solved)} discretizations that somebody solves, policies "
        f"trained on another single one lose more than {FAIL_MARGIN} of success by overfitting; "
        f"those trained on {mixture} lose no more than that in {len(kept)} of these{trained}{rest}."
    ]


def _on_truth(mixture: str, truth: Mapping[str, float]) -> list[str]:
    singles = [rate for row, rate in truth.items() if row != mixture]
    if not singles:
        return []
    return [
        f"On the truth they succeed in {percent(truth[mixture])} of the episodes, policies of "
        f"single discretizations in {percent(min(singles))} to {percent(max(singles))}."
    ]
