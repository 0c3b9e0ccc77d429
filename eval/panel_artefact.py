"""From a finished panel's directory to ``panel.json``, the figures and the page."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

from integ_gym.eval.artefact import Layout, build_artefact
from integ_gym.eval.figures import write_figures
from integ_gym.eval.matrix import COLUMNS, Matrix, Row
from integ_gym.eval.panel import Unit, units_of
from integ_gym.eval.report import write_report
from integ_gym.eval.run_directory import RunDirectory, write_json
from integ_gym.eval.spec import PanelSpec
from integ_gym.evidence.store import EvidenceStore


def write_artefact(
    spec: PanelSpec, directory: RunDirectory, command: str, wall_seconds: float, workers: int
) -> dict[str, Any]:
    """Reduce the evidence and write ``panel.json``, ``figures/`` and ``report.html``."""
    layout = layout_of(spec)
    matrix = Matrix(layout.rows, evaluation_records(directory), spec.episodes)
    facts = {
        "name": spec.name,
        "question": spec.question,
        "spec": spec.to_json(),
        "command": command,
        "training_steps": spec.training.get("total_steps"),
        "policies": {unit.policy: _policy(unit, directory) for unit in units_of(spec)},
        "cost": _cost(spec, directory, wall_seconds, workers),
        "directory": str(directory.path),
        "seeds_total": len(spec.seeds),
    }
    panel = build_artefact(layout, matrix, facts)
    for entry in panel["matrix"]:
        entry.update(whereabouts(entry, layout, directory.path))
    write_outputs(panel, directory.path)
    return panel


def write_outputs(panel: dict[str, Any], directory: Path) -> None:
    """Write ``panel.json``, the figures and the page."""
    write_json(directory / "panel.json", panel)
    write_figures(panel, directory / "figures")
    write_report(panel, directory)


def evaluation_records(directory: RunDirectory) -> list[dict[str, Any]]:
    """Summaries of all evaluation episodes."""
    store = EvidenceStore(directory.evidence)
    table = store.query(f"SELECT {', '.join(COLUMNS)} FROM records WHERE phase = 'evaluation'")
    return table.to_pylist()  # type: ignore[no-any-return]


def layout_of(spec: PanelSpec) -> Layout:
    """Rows and cells of a panel."""
    groups: dict[str, list[Unit]] = {}
    for unit in units_of(spec):
        groups.setdefault(unit.row, []).append(unit)
    order = [d.name for d in spec.train] + list(spec.baselines)
    rows = tuple(
        Row(
            name=name,
            kind="baseline" if name in spec.baselines else "trained",
            policies=tuple(unit.policy for unit in groups[name]),
            home=None if name in spec.baselines else name,
        )
        for name in order
    )
    homes = {d.name: d for d in spec.train}
    own_cells = {name: spec.cells_of(homes.get(name)) for name in order}
    cells = {cell.name: cell for cell in spec.columns()}
    for row_cells in own_cells.values():
        cells.update({cell.name: cell for cell in row_cells if cell.name not in cells})
    return Layout(
        rows=rows,
        homes=homes,
        cells=cells,
        cells_of={name: tuple(c.name for c in own) for name, own in own_cells.items()},
        reference=spec.columns()[-1].name,
        family=spec.family,
        compare=spec.compare,
    )


def _policy(unit: Unit, directory: RunDirectory) -> dict[str, Any]:
    marker = directory.marker(unit.evaluation) or {}
    file = None if unit.home is None else f"policies/{unit.policy}/policy.zip"
    return {"id": unit.policy, "seed": unit.seed, "hash": marker.get("policy"), "file": file}


def _cost(
    spec: PanelSpec, directory: RunDirectory, wall_seconds: float, workers: int
) -> dict[str, Any]:
    def total(names: list[str]) -> float:
        markers = [directory.marker(name) or {} for name in names]
        return round(sum(float(marker.get("seconds", 0.0)) for marker in markers), 1)

    units = units_of(spec)
    return {
        "wall_seconds": round(wall_seconds, 1),
        "workers": workers,
        "train_seconds": total([unit.training for unit in units]),
        "evaluate_seconds": total([unit.evaluation for unit in units]),
    }


def whereabouts(entry: dict[str, Any], layout: Layout, path: Path) -> dict[str, Any]:
    """Where the records behind an entry are, and the query that lists them."""
    row = next(row for row in layout.rows if row.name == entry["row"])
    files = [f"evidence/evaluate-{policy}.parquet" for policy in row.policies]
    policies = ", ".join(f"'{policy}'" for policy in row.policies)
    sql = (
        "SELECT record_id, episode_index, success, failure_label FROM records "
        f"WHERE cell = '{entry['cell']}' AND policy_id IN ({policies})"
    )
    return {"file": files, "query": shlex.join(["integ-gym", "evidence", "query", str(path), sql])}
