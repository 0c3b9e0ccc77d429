"""Losses of success: the declared family with its verdicts, and the rest of the matrix."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from integ_gym.support import fixed

from ...panel.model import Estimate, Panel, Verdict
from ...verdict import EQUIVALENCE_MARGIN, FAIL_MARGIN
from .axes import difference_axis
from .forest import Block, Forest, Line, Mark, Tone

VERDICT_ORDER: Final = ("fails", "transfers", "inconclusive", "not_learned")
"""Order in which verdicts are shown."""

SHOWN_GAPS: Final = 30
"""Exploratory gaps that are drawn; all of them are among the records."""


@dataclass(frozen=True)
class Gap:
    """A loss of success with its interval, and where it comes from; no verdict: exploratory."""

    row: str
    cell: str
    quantity: str
    value: Estimate
    verdict: Tone | None = None


def ordered_verdicts(panel: Panel) -> tuple[Verdict, ...]:
    """Judgements of the declared family, the ones that matter most first."""

    def order(judged: Verdict) -> tuple[int, float]:
        return VERDICT_ORDER.index(judged.verdict), -judged.gap.estimate

    return tuple(sorted(panel.verdicts, key=order))


def declared_gaps(panel: Panel) -> tuple[Gap, ...]:
    """Gaps of the declared family, largest first; a row that did not learn has none."""
    return _largest_first(
        Gap(judged.row, judged.cell, judged.quantity, judged.gap, judged.verdict)
        for judged in ordered_verdicts(panel)
        if judged.verdict != "not_learned"
    )


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
    return _largest_first(gaps)


def _largest_first(gaps: Iterable[Gap]) -> tuple[Gap, ...]:
    return tuple(sorted(gaps, key=lambda gap: -gap.value.estimate))


def gap_forest(panel: Panel) -> Forest | None:
    """The declared family, then the largest of the rest; None without any gap."""
    declared, others = declared_gaps(panel), exploratory_gaps(panel)
    shown = (*declared, *others[:SHOWN_GAPS])
    if not shown:
        return None
    more = f", the {SHOWN_GAPS} largest of {len(others)}" if len(others) > SHOWN_GAPS else ""
    found = (("declared family", declared), (f"exploratory{more}", others[:SHOWN_GAPS]))
    return Forest(
        "Transfer gaps",
        f"loss of success against policies trained there, or against home (home drop); shaded: "
        f"±{EQUIVALENCE_MARGIN}, dashed: {FAIL_MARGIN}{_level(shown)}",
        difference_axis((gap.value for gap in shown), margins=True),
        tuple(Block(title, [_line(gap) for gap in gaps]) for title, gaps in found if gaps),
    )


def _level(gaps: Iterable[Gap]) -> str:
    """What to say of the level that the intervals share; nothing where they have none."""
    levels = {gap.value.level for gap in gaps if gap.value.level is not None}
    percent = f"{100 * levels.pop():.0f} %, " if len(levels) == 1 else ""
    return f"; intervals over seeds, {percent}not adjusted"


def _line(gap: Gap) -> Line:
    low, high = gap.value.ends
    details = [f"{fixed(low)} to {fixed(high)}"] if gap.value.bounded else []
    details += ["home drop"] if gap.quantity == "home_drop" else []
    return Line(
        gap.row,
        gap.cell,
        (gap.row, gap.cell),
        (Mark(gap.value, gap.verdict or "soft", filled=gap.verdict is not None),),
        fixed(gap.value.estimate, 2, True),
        ", ".join(details),
        f"{gap.row} on {gap.cell}: {gap.quantity.replace('_', ' ')} {gap.value}",
    )
