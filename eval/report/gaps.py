"""The report's part on losses of success: verdicts, and the matrix's gaps side by side."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

from integ_gym.eval import verdict as rules
from integ_gym.eval.formatting import true_minus
from integ_gym.eval.panel_model import Estimate, Panel, Verdict
from integ_gym.eval.report.axes import Axis, difference_axis
from integ_gym.eval.report_data.gaps import (
    Gap,
    declared_gaps,
    exploratory_gaps,
    ordered_verdicts,
)

SHOWN_GAPS: Final = 30
"""Exploratory gaps that are drawn; all of them are among the records."""


def gap_parts(panel: Panel) -> dict[str, Any]:
    """`cards`, the verdicts of the declared family, and `gaps`, on one axis."""
    declared, exploratory = declared_gaps(panel), exploratory_gaps(panel)
    shown = exploratory[:SHOWN_GAPS]
    axis = difference_axis([gap.value for gap in (*declared, *shown)])

    def lines(gaps: Sequence[Gap]) -> list[dict[str, Any]]:
        return [{"gap": gap, "bar": axis.bar(gap.value)} for gap in gaps]

    return {
        "cards": [_card(judged, axis) for judged in ordered_verdicts(panel)],
        "gaps": {
            "axis": axis,
            "declared": lines(declared),
            "exploratory": lines(shown),
            "total": len(exploratory),
            "levels": _level([gap.value for gap in (*declared, *shown)]),
            "drops": any(gap.quantity == "home_drop" for gap in (*declared, *shown)),
        },
    }


def _card(judged: Verdict, axis: Axis) -> dict[str, Any]:
    """One verdict of the declared family."""
    p_values = [
        (f"gap > {rules.FAIL_MARGIN}", judged.p_exceeds_adjusted),
        (f"gap within ±{rules.EQUIVALENCE_MARGIN}", judged.p_equivalent_adjusted),
    ]
    marks = {"fails": "✕", "transfers": "✓", "inconclusive": "?", "not_learned": "○"}
    drawn = judged.verdict != "not_learned"
    return {
        "judged": judged,
        "mark": marks[judged.verdict],
        "word": judged.verdict.replace("_", " "),
        "quantity": judged.quantity.replace("_", " "),
        "bar": axis.bar(judged.gap) if drawn else None,
        "axis": axis,
        "reason": true_minus(judged.reason),
        "p_values": [(words, rules.p_text(p)) for words, p in p_values if p is not None],
    }


def _level(values: Iterable[Estimate]) -> str:
    """The level that the intervals share, as text; empty where they have none or several."""
    levels = {value.level for value in values if value.level is not None}
    return f"{levels.pop():.0%}".replace("%", " %") if len(levels) == 1 else ""
