"""The report's part on perturbations: success before and after each."""

from __future__ import annotations

from typing import Any

from integ_gym.eval.formatting import fixed
from integ_gym.eval.panel_model import Panel
from integ_gym.eval.report.axes import RATE_AXIS
from integ_gym.eval.report_data.checks import Check, checks_of


def check_blocks(panel: Panel) -> list[dict[str, Any]]:
    """For every perturbation, a line for each row that met it."""
    return [
        {"label": label, "lines": [_check(check) for check in checks]}
        for label, checks in checks_of(panel).items()
    ]


def _check(check: Check) -> dict[str, Any]:
    before = None if check.before is None else check.before.success
    after = check.after.success
    change = None if before is None else after.estimate - before.estimate
    base = check.after.cell if check.before is None else check.before.cell
    return {
        "row": check.after.row,
        "cell": base,
        "perturbed": check.after.cell,
        "before": before,
        "after": after,
        "before_bar": None if before is None else RATE_AXIS.bar(before),
        "after_bar": RATE_AXIS.bar(after),
        "change": fixed(change, sign=True),
    }
