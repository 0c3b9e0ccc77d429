"""The report's comparisons of two policies under refinement."""

from __future__ import annotations

from typing import Any

from integ_gym.eval.formatting import true_minus
from integ_gym.eval.panel_model import PolicyComparison
from integ_gym.eval.report.axes import difference_axis

_ROLES = {"quarter_step": "dt/4", "reference": "truth"}
_TONES = {"accepted": "transfers", "rejected": "fails", "uninformative": "inconclusive"}
_MARKS = {"accepted": "✓", "rejected": "✕", "uninformative": "?"}


def comparison_of(compared: PolicyComparison) -> dict[str, Any]:
    """One comparison of two policies."""
    axis = difference_axis([cell.difference for cell in compared.cells], 0.5)
    return {
        "compared": compared,
        "tone": _TONES[compared.outcome],
        "mark": _MARKS[compared.outcome],
        "reason": true_minus(compared.reason),
        "cells": [
            {
                "name": cell.name,
                "role": _ROLES.get(cell.role or ""),
                "status": cell.status.replace("_", " "),
                "value": cell.difference,
                "bar": axis.bar(cell.difference),
            }
            for cell in compared.cells
        ],
        "axis": axis,
    }
