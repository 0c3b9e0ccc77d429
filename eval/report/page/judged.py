"""The report's verdicts on the declared family, and its comparisons of two policies."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from integ_gym.support.terminal import fixed, true_minus

from ...panel.model.conclusions import CellFinding, PolicyComparison, Verdict
from ...panel.model.panel import Panel
from ...panel.model.part import Estimate
from ...verdict.rules import EQUIVALENCE_MARGIN, FAIL_MARGIN, p_text
from ..data.axes import difference_axis
from ..data.forest import Line, Mark, Tone
from ..data.gaps import VERDICT_ORDER

_ROLES = {"quarter_step": "dt/4", "reference": "truth"}
_TONES: dict[str, Tone] = {
    "accepted": "transfers", "rejected": "fails", "uninformative": "inconclusive",
}  # fmt: skip
_SIGNS = {"accepted": "✓", "rejected": "✕", "uninformative": "?"}

_VERDICTS: dict[str, tuple[str, Tone]] = {
    "fails": ("✕", "fails"),
    "transfers": ("✓", "transfers"),
    "inconclusive": ("?", "inconclusive"),
}
"""Sign and colour of a verdict."""

_WITHOUT: tuple[str, Tone] = ("○", "not_learned")
_WORTH_TELLING = 0.1
"""Loss of success of a single seed that is named."""

_PARTS = ("difficulty", "deadline", "overfitting")


def card_of(panel: Panel, judged: Verdict) -> dict[str, Any]:
    """One verdict of the declared family."""
    p_values = [
        (f"overfitting > {FAIL_MARGIN}", judged.p_exceeds_adjusted),
        (f"overfitting within ±{EQUIVALENCE_MARGIN}", judged.p_equivalent_adjusted),
    ]
    sign, tone = _VERDICTS.get(judged.verdict, _WITHOUT)
    return {
        "judged": judged,
        "sign": sign,
        "word": _words(judged.verdict),
        "tone": tone,
        "parts": [(part, _signed(getattr(judged, part))) for part in _PARTS],
        "total": _signed(judged.total),
        "marks": [Mark(judged.overfitting, tone)] if judged.verdict in _VERDICTS else [],
        "reason": true_minus(judged.reason),
        "tail": _tail(panel, judged),
        "wanted": judged.seeds_wanted,
        "p_values": [(words, p_text(p)) for words, p in p_values if p is not None],
    }


def _tail(panel: Panel, judged: Verdict) -> dict[str, Any] | None:
    """How many seeds lose most of their success, and where the worst one's episodes are."""
    entry = panel.entry(judged.row, judged.cell)
    if entry is None or entry.tail is None or entry.worst_policy is None:
        return None
    ids = [policy.id for policy in panel.row(judged.row).policies]
    return {
        "share": entry.tail,
        "policy": entry.worst_policy,
        "loss": fixed(entry.worst_loss),
        "told": (entry.worst_loss or 0.0) >= _WORTH_TELLING,
        "place": f"{panel.anchor(judged.row, judged.cell)}s{ids.index(entry.worst_policy)}e0",
        "numerics": entry.numerics_share,
    }


def tally_of(cards: Sequence[dict[str, Any]]) -> list[tuple[str, int, str]]:
    """Tone, number and words of every verdict; of those that are none, only if there are some."""
    counts = Counter(card["judged"].verdict for card in cards)
    return [
        (_VERDICTS.get(name, _WITHOUT)[1], counts[name], _words(name))
        for name in VERDICT_ORDER
        if counts[name] or name in _VERDICTS
    ]


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


def _words(verdict: str) -> str:
    return verdict.replace("_", " ")


def _signed(value: Estimate) -> str:
    return fixed(value.estimate, 2, True)


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
