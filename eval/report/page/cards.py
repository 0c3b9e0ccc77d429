"""The report's verdicts on the declared family."""

from __future__ import annotations

from typing import Any

from integ_gym.support import true_minus

from ... import verdict as rules
from ...panel.model import Verdict
from ..data import Mark


def card_of(judged: Verdict) -> dict[str, Any]:
    """One verdict of the declared family."""
    p_values = [
        (f"gap > {rules.FAIL_MARGIN}", judged.p_exceeds_adjusted),
        (f"gap within ±{rules.EQUIVALENCE_MARGIN}", judged.p_equivalent_adjusted),
    ]
    marks = {"fails": "✕", "transfers": "✓", "inconclusive": "?", "not_learned": "○"}
    return {
        "judged": judged,
        "sign": marks[judged.verdict],
        "word": judged.verdict.replace("_", " "),
        "quantity": judged.quantity.replace("_", " "),
        "marks": [] if judged.verdict == "not_learned" else [Mark(judged.gap, judged.verdict)],
        "reason": true_minus(judged.reason),
        "p_values": [(words, rules.p_text(p)) for words, p in p_values if p is not None],
    }
