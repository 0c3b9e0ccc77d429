"""The verdicts of a panel as one table."""

from __future__ import annotations

from typing import Final, TextIO

from integ_gym.eval.panel.model.conclusions import Verdict
from integ_gym.eval.panel.model.panel import Panel
from integ_gym.eval.panel.model.part import Estimate
from integ_gym.eval.report.data.gaps import ordered_verdicts
from integ_gym.support.terminal.colour import (
    DIM,
    GREEN,
    RED,
    YELLOW,
)
from integ_gym.support.terminal.formatting import NONE, fixed
from integ_gym.support.terminal.text_table import print_aligned

TONES: Final = {
    "fails": RED,
    "transfers": GREEN,
    "inconclusive": YELLOW,
    "not_learned": DIM,
    "unachievable": DIM,
    "too_slow": DIM,
    "undecided": DIM,
}
"""Verdict to its colour."""

_NAMES: Final = (
    "verdict", "trained on → judged on", "success", "loss", "of it overfitting", "interval"
)  # fmt: skip


def print_verdicts(panel: Panel, file: TextIO) -> None:
    """Print the declared family, failing transfers first, in colour where the terminal has it."""
    rows = [_row(panel, judged) for judged in ordered_verdicts(panel)]
    right = (False, False, True, True, True, True)
    print_aligned(_NAMES, rows, file, right, keys=2, colours=TONES)


def _row(panel: Panel, judged: Verdict) -> tuple[str, ...]:
    there, home = panel.entry(judged.row, judged.cell), panel.row(judged.row).home_success
    success = f"{_rate(home)} → {_rate(there.success if there else None)}"
    low, high = judged.overfitting.low, judged.overfitting.high
    return (
        judged.verdict,
        panel.called(f"{judged.row} → {judged.cell}"),
        success,
        fixed(judged.total.estimate),
        fixed(judged.overfitting.estimate),
        f"{fixed(low)} to {fixed(high)}" if judged.overfitting.bounded else NONE,
    )


def _rate(estimate: Estimate | None) -> str:
    return fixed(None if estimate is None else estimate.estimate)
