"""Matrices and panels of records whose outcomes are given."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from integ_gym.eval.panel.artefact import build_artefact
from integ_gym.eval.panel.matrix import Matrix, PanelLayout
from integ_gym.eval.panel.result import Cost, Panel, Row

RECORD = {
    "replay_second_horizon": None, "return": 0.0, "time_to_success": None,
    "energy_residual_total": 0.0, "energy_residual_abs_total": 0.0, "solver_status": "ok",
    "failure_label": "none", "failure_reason": "", "arrival_energy": 10.0,
    "arrival_residual": 1.0, "duration": 10.0, "command_error": None, "terminated": False,
}  # fmt: skip
"""What a record says where no more is given."""


def matrix_of(
    layout: PanelLayout, episodes: int, outcome: Callable[[Row, str, int, int], dict[str, Any]]
) -> Matrix:
    """The records of all rows in all their cells.

    Args:
        layout: of the panel.
        episodes: of each policy in a cell.
        outcome: of row, cell, place of the policy and episode: what the record says.
    """
    records = [
        {
            **RECORD, "policy_id": policy, "cell": cell, "episode_index": k,
            "record_id": f"{policy}{cell}{k}", **outcome(row, cell, place, k),
        }
        for row in layout.rows
        for cell in layout.cells_of[row.name]
        for place, policy in enumerate(row.policy_ids)
        for k in range(episodes)
    ]  # fmt: skip
    return Matrix(layout.rows, records, episodes)


def panel_of(layout: PanelLayout, matrix: Matrix, **told: Any) -> Panel:
    """The panel of them, of which more may be told."""
    cost = Cost(wall_seconds=0.0, workers=1, train_seconds=0.0, evaluate_seconds=0.0)
    own = {"directory": "runs/mine", "name": "mine", "question": "?", "command": ""}
    own |= {"versions": {}, "spec": {}, "cost": cost}
    ids = [policy for row in layout.rows for policy in row.policy_ids]
    return build_artefact(layout, matrix, dict.fromkeys(ids, ()), **{**own, **told})
