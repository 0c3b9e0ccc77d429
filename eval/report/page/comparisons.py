"""The report's comparisons of two policies under refinement."""

from __future__ import annotations

from typing import Any

from integ_gym.support import fixed, true_minus

from ...panel.model import CellFinding, PolicyComparison
from ..data import Line, Mark, Tone, difference_axis

_ROLES = {"quarter_step": "dt/4", "reference": "truth"}
_TONES: dict[str, Tone] = {
    "accepted": "transfers", "rejected": "fails", "uninformative": "inconclusive",
}  # fmt: skip
_SIGNS = {"accepted": "✓", "rejected": "✕", "uninformative": "?"}


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
