"""Headline counts of a panel."""

from __future__ import annotations

from collections.abc import Sequence

from integ_gym.support.terminal import plural, seconds

from ...panel.model.panel import Panel
from ..data.trust import Trust


def tiles_of(panel: Panel, trusts: Sequence[Trust]) -> list[tuple[str, str]]:
    """Headline counts: (number, what it counts)."""
    trained = [row for row in panel.rows if row.kind == "trained"]
    policies = sum(row.seeds for row in panel.rows if row.kind != "baseline")
    wrong = [e for t in trusts for e in t.judged if e.contradicted]
    discretizations = sum(cell.kind in ("grid", "reference") for cell in panel.cells)
    checks = len(panel.cells) - discretizations
    more_cells = f", and {plural(checks, 'cell')} for checks" if checks else ""
    tiles = []
    if trained:
        mixtures = sum(row.mixed for row in trained)
        more = f" and {plural(mixtures, 'mixture')}" if mixtures else ""
        tiles.append((f"{len(trained) - mixtures}", f"training discretizations{more}"))
    tiles += [
        (f"{policies}", "policies" if policies != 1 else "policy"),
        (f"{discretizations}", f"evaluation discretizations{more_cells}"),
        (f"{sum(e.episodes for e in panel.matrix):,}", "episodes, each on record"),
    ]
    if trusts:
        tiles.append((f"{len(wrong)}", "answers the truth contradicts"))
    tiles.append((seconds(panel.cost.wall_seconds), _work(panel, bool(trained))))
    return tiles


def _work(panel: Panel, trained: bool) -> str:
    """What the run's time was spent on."""
    if not trained:
        return "to evaluate"
    if not panel.cost.train_seconds:
        return "to evaluate policies that another run trained"
    return "to train and evaluate"
