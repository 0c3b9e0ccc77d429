"""Losses of success: the declared family with its verdicts, and the rest of the matrix."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from integ_gym.eval.formatting import NONE
from integ_gym.eval.report_data.estimate import Estimate, estimate
from integ_gym.eval.report_data.panel import Panel
from integ_gym.eval.report_data.parts import Json

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
    anchor: str | None = None

    @property
    def declared(self) -> bool:
        """Whether it belongs to the declared family."""
        return self.verdict is not None


def verdicts_of(panel: Panel) -> tuple[tuple[Gap, Json], ...]:
    """Judgements of the declared family, the ones that matter most first."""
    judged = [(_judged(panel, raw), raw) for raw in panel.items("verdicts")]

    def order(item: tuple[Gap, Json]) -> tuple[int, float]:
        verdict = item[0].verdict
        place = VERDICT_ORDER.index(verdict) if verdict in VERDICT_ORDER else 9
        return place, -item[0].value.estimate

    return tuple(sorted(judged, key=order))


def _judged(panel: Panel, raw: Json) -> Gap:
    row, cell = str(raw.get("row", NONE)), str(raw.get("cell", NONE))
    value = estimate(raw.get("gap")) or Estimate(math.nan)
    entry = panel.entries.get((row, cell))
    return Gap(
        row,
        cell,
        str(raw.get("quantity") or "transfer_gap"),
        value,
        str(raw.get("verdict") or "inconclusive"),
        None if entry is None else entry.anchor,
    )


def declared_gaps(panel: Panel) -> tuple[Gap, ...]:
    """Gaps of the declared family, largest first; a row that did not learn has none."""
    gaps = [
        gap
        for gap, _ in verdicts_of(panel)
        if gap.verdict != "not_learned" and not math.isnan(gap.value.estimate)
    ]
    return tuple(sorted(gaps, key=lambda gap: -gap.value.estimate))


def exploratory_gaps(panel: Panel) -> tuple[Gap, ...]:
    """The matrix's other gaps, largest first; home drops where there is no transfer gap.

    Rows that did not learn and baselines have nothing to transfer and are left out.
    """
    declared = {(gap.row, gap.cell) for gap in declared_gaps(panel)}
    gaps = []
    for entry in panel.entries.values():
        if entry.row.baseline or entry.row.learned is False or entry.home:
            continue
        if (entry.row.name, entry.cell.name) in declared or entry.cell not in panel.columns:
            continue
        quantity = "home_drop" if entry.transfer_gap is None else "transfer_gap"
        value = entry.transfer_gap or entry.home_drop
        if value is not None:
            names = entry.row.name, entry.cell.name
            gaps.append(Gap(*names, quantity, value, anchor=entry.anchor))
    return tuple(sorted(gaps, key=lambda gap: -gap.value.estimate))
