"""The report's part on losses of success: verdicts, and the matrix's gaps side by side."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

from integ_gym.eval import verdict as rules
from integ_gym.eval.formatting import finite, true_minus
from integ_gym.eval.report.axes import Axis, difference_axis
from integ_gym.eval.report_data.estimate import Estimate
from integ_gym.eval.report_data.gaps import (
    VERDICT_ORDER,
    Gap,
    declared_gaps,
    exploratory_gaps,
    verdicts_of,
)
from integ_gym.eval.report_data.panel import Panel
from integ_gym.eval.report_data.parts import Json

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
        "cards": [_card(gap, raw, axis, gap in declared) for gap, raw in verdicts_of(panel)],
        "gaps": {
            "axis": axis,
            "declared": lines(declared),
            "exploratory": lines(shown),
            "total": len(exploratory),
            "levels": _level([gap.value for gap in (*declared, *shown)]),
            "drops": any(gap.quantity == "home_drop" for gap in (*declared, *shown)),
        },
    }


def _card(gap: Gap, raw: Json, axis: Axis, drawn: bool) -> dict[str, Any]:
    """One verdict of the declared family."""
    p_values = [
        (words, finite(raw.get(name)))
        for words, name in (
            (f"gap > {rules.FAIL_MARGIN}", "p_exceeds_adjusted"),
            (f"gap within ±{rules.EQUIVALENCE_MARGIN}", "p_equivalent_adjusted"),
        )
    ]
    verdict = gap.verdict if gap.verdict in VERDICT_ORDER else "inconclusive"
    return {
        "gap": gap,
        "verdict": verdict,
        "mark": {"fails": "✕", "transfers": "✓", "inconclusive": "?", "not_learned": "○"}[verdict],
        "word": {"not_learned": "not learned"}.get(verdict, verdict),
        "quantity": gap.quantity.replace("_", " "),
        "bar": axis.bar(gap.value) if drawn else None,
        "axis": axis,
        "reason": true_minus(str(raw.get("reason") or "")),
        "p_values": [
            (words, rules.p_text(value)) for words, value in p_values if value is not None
        ],
    }


def _level(values: Iterable[Estimate]) -> str:
    """The level that the intervals share, as text; empty where they have none or several."""
    levels = {value.level for value in values if value.level is not None}
    return f"{levels.pop():.0%}".replace("%", " %") if len(levels) == 1 else ""
