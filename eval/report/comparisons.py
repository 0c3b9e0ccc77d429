"""The report's comparisons of two policies under refinement."""

from __future__ import annotations

from typing import Any

from integ_gym.eval.formatting import true_minus
from integ_gym.eval.report.axes import difference_axis
from integ_gym.eval.report_data.estimate import estimate
from integ_gym.eval.report_data.parts import Json


def comparison_of(raw: Json) -> dict[str, Any]:
    """One comparison of two policies."""
    cells = []
    differences = [estimate(cell.get("difference")) for cell in raw.get("cells") or []]
    axis = difference_axis([value for value in differences if value is not None], 0.5)
    for cell, value in zip(raw.get("cells") or [], differences, strict=True):
        cells.append(
            {
                "name": str(cell.get("name")),
                "role": {"quarter_step": "dt/4", "reference": "truth"}.get(str(cell.get("role"))),
                "status": str(cell.get("status") or "undecided").replace("_", " "),
                "value": value,
                "bar": None if value is None else axis.bar(value),
            }
        )
    outcome = str(raw.get("outcome") or "uninformative")
    tones = {"accepted": "transfers", "rejected": "fails"}
    return {
        "a": str(raw.get("a")),
        "b": str(raw.get("b")),
        "outcome": outcome,
        "tone": tones.get(outcome, "inconclusive"),
        "mark": {"accepted": "✓", "rejected": "✕"}.get(outcome, "?"),
        "reason": true_minus(str(raw.get("reason") or "")),
        "cells": cells,
        "axis": axis,
    }
