"""The report's part on failures: their labels, and a sample of episodes."""

from __future__ import annotations

from collections import Counter
from typing import Any, Final

from ...panel.model.conclusions import Failure
from ...panel.model.panel import Panel
from ..episodes.told import Told
from .commands import readable

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
    """Failures of policies that are no baselines, by row and label, with shares of the row's."""
    rows = [row.name for row in panel.ordered_rows if not row.baseline]
    by_row: dict[str, Counter[str]] = {row: Counter() for row in rows}
    for entry in panel.matrix:
        if entry.row in by_row:
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


def failures_of(panel: Panel, told: Told | None = None) -> list[dict[str, Any]]:
    """The sample of failing episodes, by label, each with what shows it.

    That is a place on this page if it carries the episode, or else a command.
    """
    by_label: dict[str, list[dict[str, Any]]] = {}
    for failure in panel.failures:
        words = ("integ-gym", "evidence", "show", panel.directory, failure.record_id)
        record = {
            "failure": failure,
            "episode": _episode(panel, failure) if told else None,
            "command": readable(words),
        }
        by_label.setdefault(failure.label, []).append(record)
    labels = sorted(by_label, key=lambda name: -len(by_label[name]))
    return [{"label": label, "records": by_label[label]} for label in labels]


def _episode(panel: Panel, failure: Failure) -> str | None:
    """Where the page shows an episode."""
    anchor = panel.anchor(failure.row, failure.cell)
    policies = [policy.id for policy in panel.row(failure.row).policies]
    if anchor is None or failure.policy not in policies:
        return None
    return f"{anchor}s{policies.index(failure.policy)}e{failure.episode_index}"
