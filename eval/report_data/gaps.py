"""Losses of success: the declared family with its verdicts, and the rest of the matrix."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from integ_gym.eval.panel_model import Estimate, Panel, Verdict

VERDICT_ORDER: Final = ("fails", "transfers", "inconclusive", "not_learned")
"""Order in which verdicts are shown."""


@dataclass(frozen=True)
class Gap:
    """A loss of success with its interval, and where it comes from."""

    row: str
    cell: str
    quantity: str
    value: Estimate
    verdict: str | None = None


def ordered_verdicts(panel: Panel) -> tuple[Verdict, ...]:
    """Judgements of the declared family, the ones that matter most first."""

    def order(judged: Verdict) -> tuple[int, float]:
        return VERDICT_ORDER.index(judged.verdict), -judged.gap.estimate

    return tuple(sorted(panel.verdicts, key=order))


def declared_gaps(panel: Panel) -> tuple[Gap, ...]:
    """Gaps of the declared family, largest first; a row that did not learn has none."""
    gaps = (
        Gap(judged.row, judged.cell, judged.quantity, judged.gap, judged.verdict)
        for judged in ordered_verdicts(panel)
        if judged.verdict != "not_learned"
    )
    return tuple(sorted(gaps, key=lambda gap: -gap.value.estimate))


def exploratory_gaps(panel: Panel) -> tuple[Gap, ...]:
    """The matrix's other gaps, largest first; home drops where there is no transfer gap.

    Rows that did not learn and baselines have nothing to transfer and are left out.
    """
    declared = {(gap.row, gap.cell) for gap in declared_gaps(panel)}
    columns = {cell.name for cell in panel.columns}
    gaps = []
    for entry in panel.matrix:
        row = panel.row(entry.row)
        if row.baseline or row.learned is False or entry.cell in row.shares:
            continue
        if (entry.row, entry.cell) in declared or entry.cell not in columns:
            continue
        quantity = "home_drop" if entry.transfer_gap is None else "transfer_gap"
        value = entry.transfer_gap or entry.home_drop
        if value is not None:
            gaps.append(Gap(entry.row, entry.cell, quantity, value))
    return tuple(sorted(gaps, key=lambda gap: -gap.value.estimate))
