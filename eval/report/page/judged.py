"""The report's verdicts on the declared family, and its comparisons of two policies."""

from __future__ import annotations

from typing import Any

from integ_gym.support import fixed, true_minus

from ... import verdict as rules
from ...panel.model import CellFinding, PolicyComparison, Verdict
from ..data import Line, Mark, Tone, difference_axis

_ROLES = {"quarter_step": "dt/4", "reference": "truth"}
_TONES: dict[str, Tone] = {
    "accepted": "transfers", "rejected": "fails", "uninformative": "inconclusive",
}  # fmt: skip
_SIGNS = {"accepted": "✓", "rejected": "✕", "uninformative": "?"}


def card_of(judged: Verdict) -> dict[str, Any]:
    """One verdict of the declared family."""
    p_values = [
        (f"overfitting > {rules.FAIL_MARGIN}", judged.p_exceeds_adjusted),
        (f"overfitting within ±{rules.EQUIVALENCE_MARGIN}", judged.p_equivalent_adjusted),
    ]
    signs = {"fails": "✕", "transfers": "✓", "inconclusive": "?"}
    judged_at_all = judged.verdict not in rules.WITHOUT_VERDICT
    tone: Any = judged.verdict if judged_at_all else "not_learned"
    return {
        "judged": judged,
        "sign": signs.get(judged.verdict, "○"),
        "word": judged.verdict.replace("_", " "),
        "tone": tone,
        "marks": [Mark(judged.overfitting, tone)] if judged_at_all else [],
        "reason": true_minus(judged.reason),
        "p_values": [(words, rules.p_text(p)) for words, p in p_values if p is not None],
    }


def comparison_of(compared: PolicyComparison) -> dict[str, Any]:
    """One comparison of two policies."""
    tone = _TONES[compared.outcome]
    return {
        "compared": compared,
        "tone": tone,
        "sign": _SIGNS[compared.outcome],
        "reason": true_minus(compared.reason),
        "lines": [_line(compared, cell, tone) for cell in compared.cells],
        "axis": difference_axis([cell.difference for cell in compared.cells], 0.5),
    }


def _line(compared: PolicyComparison, cell: CellFinding, tone: Tone) -> Line:
    return Line(
        "",
        cell.name,
        (compared.a, cell.name),
        (Mark(cell.difference, tone),),
        fixed(cell.difference.estimate, 2, True),
        cell.status.replace("_", " "),
        f"A − B {cell.difference}",
        _ROLES.get(cell.role or "", ""),
    )
