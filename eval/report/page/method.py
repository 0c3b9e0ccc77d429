"""The report's part on method: what the panel cannot say, and its settings."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from typing import Any

from integ_gym.support.terminal import plural

from ...panel.model.matrix import AppliedDiscretization
from ...panel.model.panel import Panel
from ...verdict.rules import LEARNED, MIN_SEEDS


def limits_of(panel: Panel) -> list[str]:
    """What this panel cannot say, from its own numbers."""
    rows = [row for row in panel.rows if not (row.baseline or panel.given_alone)]
    fewest = min((row.seeds for row in rows), default=0)
    limits = []
    if rows and fewest < MIN_SEEDS:
        limits.append(
            f"Some rows have {plural(fewest, 'seed')}; below {MIN_SEEDS} seeds nothing is "
            "concluded, whatever the numbers look like."
        )
    if rows and fewest < 30:
        limits.append(
            "Showing that a policy transfers takes many seeds: with every rate at 1.0, 30 a side "
            "in a family of one and 47 in a family of six. "
            f"Here the rows have {fewest} or more, so inconclusive is not the same as fails."
        )
    if panel.truth is None:
        limits.append("There is no truth column, so no class against the truth.")
    unlearned = [row.name for row in rows if row.learned is False]
    if unlearned:
        limits.append(
            f"Not learned, hence without a verdict: {', '.join(unlearned)} (home success below "
            f"{LEARNED})."
        )
    limits += panel.protocol_gaps
    if panel.given_alone:
        return [*limits, "Another seed of the same training could do otherwise."]
    limits.append(
        "Everything outside the declared family is exploratory: its intervals are not adjusted "
        "for how many there are."
    )
    return limits


def applied_of(panel: Panel) -> list[tuple[AppliedDiscretization, int]]:
    """What environments really did, each with the number of cells that it goes for, as in it."""
    found = Counter(cell.applied for cell in panel.cells if cell.applied is not None)
    return list(found.items())


def settings_of(panel: Panel) -> list[tuple[str, str]]:
    """Entries of the spec that are plain values, and the environment's own arguments."""
    spec = panel.spec
    flat = [(str(name), _plain(value)) for name, value in spec.items() if _is_plain(value)]
    for group in ("environment", "training"):
        inner = spec.get(group)
        if isinstance(inner, Mapping):
            flat += [(str(name), _plain(value)) for name, value in inner.items()]
    return flat


def _is_plain(value: Any) -> bool:
    if isinstance(value, list):
        return bool(value) and all(not isinstance(item, list | Mapping) for item in value)
    return not isinstance(value, Mapping)


def _plain(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "none"}[value]
    if isinstance(value, list):
        return ", ".join(_plain(item) for item in value)
    return json.dumps(value) if isinstance(value, Mapping) else str(value)
