"""The report's part on failures: their labels, and a sample of episodes."""

from __future__ import annotations

import shlex
from typing import Any, Final

from integ_gym.eval.report_data.panel import Panel
from integ_gym.eval.report_data.parts import Json

LABEL_WORDS: Final = {
    "evaluation_error": "simulator or metric broke",
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
    if not panel.labels:
        return None
    names = [name for name in LABEL_WORDS if any(name in c for c in panel.labels.values())]
    others = {name for counts in panel.labels.values() for name in counts} - set(names)
    names += sorted(others)
    lines = []
    for row, counts in panel.labels.items():
        total = sum(counts.values())
        shares = [(counts.get(name, 0), counts.get(name, 0) / total) for name in names]
        lines.append({"row": row, "total": total, "shares": shares})
    return {"labels": names, "lines": lines}


def failures_of(panel: Panel) -> list[dict[str, Any]]:
    """The sample of failing episodes, by label, each with the command that shows its record."""
    by_label: dict[str, list[dict[str, Any]]] = {}
    for raw in panel.items("failures"):
        label = str(raw.get("label") or "unattributed")
        by_label.setdefault(label, []).append(_failure(panel, raw))
    labels = sorted(by_label, key=lambda name: -len(by_label[name]))
    return [{"label": label, "records": by_label[label]} for label in labels]


def _failure(panel: Panel, raw: Json) -> dict[str, Any]:
    row, cell = str(raw.get("row")), str(raw.get("cell"))
    entry = panel.entries.get((row, cell))
    words = ("integ-gym", "evidence", "show", _folder(panel), str(raw.get("record_id")))
    return {
        "row": row,
        "cell": cell,
        "anchor": None if entry is None else entry.anchor,
        "policy": raw.get("policy"),
        "episode": raw.get("episode_index"),
        "reason": str(raw.get("reason") or "no reason recorded"),
        "command": " ".join(shlex.quote(word) for word in words),
    }


def _folder(panel: Panel) -> str:
    """The panel's directory as its command names it, else the one that holds the report."""
    try:
        words = shlex.split(panel.text("command"))
    except ValueError:
        return "."
    for place, word in enumerate(words):
        if word == "--out" and place + 1 < len(words):
            return words[place + 1]
        if word.startswith("--out="):
            return word.removeprefix("--out=")
    return "."
