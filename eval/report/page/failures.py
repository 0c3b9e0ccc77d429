"""The report's part on failures: their labels, and a sample of episodes."""

from __future__ import annotations

import shlex
from collections import Counter
from typing import Any, Final

from ...panel.model import Panel

LABEL_WORDS: Final = {
    "evaluation_error": "simulator or metric broke",
    "unachievable": "a search over controls misses the goal's energy from most starts",
    "not_learned": "the policy fails at home, too",
    "too_slow": "succeeds from the same start in twice the time",
    "discretization_error": "succeeds from the same start at home",
    "perception_error": "succeeds without sensor noise",
    "state_error": "succeeds without delay or staleness",
    "control_error": "saturated, or left the goal after reaching it",
    "planning_error": "never reached the goal, unsaturated",
    "unattributed": "a needed replay was not run",
}
"""Failure labels in words, in the order in which their rules are tried."""


def failure_table(panel: Panel) -> dict[str, Any] | None:
    """Failures by row and label, with the share of each label in its row."""
    by_row: dict[str, Counter[str]] = {row.name: Counter() for row in panel.ordered_rows}
    for entry in panel.matrix:
        by_row[entry.row].update(entry.labels)
    for counts in by_row.values():
        counts.pop("none", None)
    failed = {row: counts for row, counts in by_row.items() if counts.total()}
    if not failed:
        return None
    found = {name for counts in failed.values() for name in counts}
    names = [*(name for name in LABEL_WORDS if name in found), *sorted(found - set(LABEL_WORDS))]
    lines = []
    for row, counts in failed.items():
        shares = [(counts[name], counts[name] / counts.total()) for name in names]
        lines.append({"row": row, "total": counts.total(), "shares": shares})
    return {"labels": names, "lines": lines, "total": sum(c.total() for c in failed.values())}


def failures_of(panel: Panel) -> list[dict[str, Any]]:
    """The sample of failing episodes, by label, each with the command that shows its record."""
    by_label: dict[str, list[dict[str, Any]]] = {}
    for failure in panel.failures:
        words = ("integ-gym", "evidence", "show", panel.directory, failure.record_id)
        record = {"failure": failure, "command": shlex.join(words)}
        by_label.setdefault(failure.label, []).append(record)
    labels = sorted(by_label, key=lambda name: -len(by_label[name]))
    return [{"label": label, "records": by_label[label]} for label in labels]
