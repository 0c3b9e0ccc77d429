"""Losses by overfitting: the declared family with its verdicts, and the rest of the matrix."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from integ_gym.support.terminal import fixed, percent

from ...panel.model.conclusions import Verdict
from ...panel.model.panel import Panel
from ...panel.model.part import Estimate
from ...verdict.family import WITHOUT_VERDICT
from ...verdict.rules import EQUIVALENCE_MARGIN, FAIL_MARGIN
from .axes import difference_axis
from .forest import Block, Forest, Line, Mark, Tone

VERDICT_ORDER: Final = ("fails", "transfers", "inconclusive", *WITHOUT_VERDICT)
"""Order in which verdicts are shown."""

SHOWN_GAPS: Final = 30
"""Exploratory gaps that are drawn; all of them are among the records."""


@dataclass(frozen=True)
class Gap:
    """Overfitting with its interval, and where it comes from; no verdict: exploratory."""

    row: str
    cell: str
    value: Estimate
    verdict: Tone | None = None


def ordered_verdicts(panel: Panel) -> tuple[Verdict, ...]:
    """Judgements of the declared family, the ones that matter most first."""

    def order(judged: Verdict) -> tuple[int, float]:
        return VERDICT_ORDER.index(judged.verdict), -judged.overfitting.estimate

    return tuple(sorted(panel.verdicts, key=order))


def declared_gaps(panel: Panel) -> tuple[Gap, ...]:
    """Those of the declared family that have a verdict, largest first."""
    return _largest_first(
        Gap(judged.row, judged.cell, judged.overfitting, judged.verdict)  # type: ignore[arg-type]
        for judged in ordered_verdicts(panel)
        if judged.verdict not in WITHOUT_VERDICT
    )


def exploratory_gaps(panel: Panel) -> tuple[Gap, ...]:
    """Those of the rest of the matrix, largest first."""
    return tuple(
        Gap(entry.row, entry.cell, entry.overfitting)
        for entry in panel.undeclared
        if entry.overfitting is not None
    )


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
        "Overfitting",
        f"loss of success that neither difficulty nor a deadline explains; shaded: "
        f"±{EQUIVALENCE_MARGIN}, dashed: {FAIL_MARGIN}{_level(panel, shown)}",
        "loss of success by overfitting",
        difference_axis((gap.value for gap in shown), margins=True),
        tuple(Block(title, [_line(panel, gap) for gap in gaps]) for title, gaps in found if gaps),
    )


def _level(panel: Panel, gaps: Iterable[Gap]) -> str:
    """What to say of the level that the intervals share; nothing where they have none."""
    levels = {gap.value.level for gap in gaps if gap.value.level is not None}
    level = f"{percent(levels.pop())}, " if len(levels) == 1 else ""
    over = "starts" if panel.given_alone else "seeds"
    return f"; intervals over {over}, {level}not adjusted"


def _line(panel: Panel, gap: Gap) -> Line:
    low, high = gap.value.ends
    details = [f"{fixed(low)} to {fixed(high)}"] if gap.value.bounded else []
    return Line(
        panel.called(gap.row),
        panel.called(gap.cell),
        (gap.row, gap.cell),
        (Mark(gap.value, gap.verdict or "soft", filled=gap.verdict is not None),),
        fixed(gap.value.estimate, 2, True),
        ", ".join(details),
        f"{gap.row} on {gap.cell}: overfitting {gap.value}",
    )
