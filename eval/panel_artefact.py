"""From a finished panel's directory to ``panel.json``, the figures and the page."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from integ_gym.eval.artefact import build_artefact
from integ_gym.eval.cells import Home
from integ_gym.eval.engine_agreement import agreement_answer, agreements
from integ_gym.eval.evaluation_units import Evaluated, evaluated
from integ_gym.eval.figures import write_figures
from integ_gym.eval.matrix import COLUMNS, Matrix, Row
from integ_gym.eval.panel_layout import PanelLayout
from integ_gym.eval.report import write_report
from integ_gym.eval.run_directory import RunDirectory, write_json
from integ_gym.eval.spec import PanelSpec
from integ_gym.eval.training_cost import training_costs
from integ_gym.eval.units import Unit, training_config, units_of
from integ_gym.evidence.store import EvidenceStore


def write_artefact(
    spec: PanelSpec, directory: RunDirectory, command: str, workers: int
) -> dict[str, Any]:
    """Reduce the evidence and write ``panel.json``, ``figures/`` and ``report.html``."""
    layout = layout_of(spec)
    matrix = Matrix(layout.rows, evaluation_records(directory), spec.episodes)
    held = evaluated(directory)
    facts = {
        "name": spec.name,
        "question": spec.question,
        "spec": spec.to_json(),
        "protocol_gaps": spec.gaps(),
        "command": command,
        "training_steps": _training_steps(spec),
        "training_costs": training_costs(
            EvidenceStore(directory.evidence),
            {row.name: row.policies for row in layout.rows if row.kind == "trained"},
        ),
        "policies": {unit.policy: _policy(unit, held) for unit in units_of(spec)},
        "cost": cost_of(directory, [unit.training for unit in units_of(spec)], workers),
        "directory": str(directory.path),
        "seeds_total": len(spec.seeds),
    }
    panel = build_artefact(layout, matrix, facts)
    panel["versions"] = directory.versions()
    panel["engine_agreement"] = agreements(layout, matrix, spec)
    if not spec.family:
        panel["answer"] = agreement_answer(panel["engine_agreement"]) or panel["answer"]
    write_outputs(panel, layout, directory)
    return panel


def write_outputs(panel: dict[str, Any], layout: PanelLayout, directory: RunDirectory) -> None:
    """Write ``panel.json``, with where its records are, the figures and the page."""
    held = evaluated(directory)
    for entry in panel["matrix"]:
        entry.update(_whereabouts(entry, layout, held, directory.path))
    write_json(directory.path / "panel.json", panel)
    write_figures(panel, directory.path / "figures")
    write_report(panel, directory.path)


def evaluation_records(directory: RunDirectory) -> list[dict[str, Any]]:
    """Summaries of all evaluation episodes."""
    store = EvidenceStore(directory.evidence)
    table = store.query(f"SELECT {', '.join(COLUMNS)} FROM records WHERE phase = 'evaluation'")
    return table.to_pylist()  # type: ignore[no-any-return]


def layout_of(spec: PanelSpec) -> PanelLayout:
    """Rows and cells of a panel with training."""
    groups: dict[str, list[Unit]] = {}
    for unit in units_of(spec):
        groups.setdefault(unit.row, []).append(unit)
    homes = {home.name: home for home in spec.train}
    rows = tuple(
        Row(
            name=name,
            kind="baseline" if name in spec.baselines else "trained",
            policies=tuple(unit.policy for unit in groups[name]),
            shares=shares_of(homes.get(name)),
        )
        for name in (*homes, *spec.baselines)
    )
    return make_layout(spec, rows, homes)


def shares_of(home: Home | None) -> dict[str, float]:
    """Share of each cell, by name, that a policy was trained in."""
    return {} if home is None else {d.name: share for d, share in home.shares.items()}


def make_layout(spec: PanelSpec, rows: tuple[Row, ...], homes: Mapping[str, Home]) -> PanelLayout:
    """Rows with the cells that each is evaluated in.

    Args:
        spec: the panel.
        rows: its rows.
        homes: training discretization or mixture by row name.
    """
    own_cells = {row.name: spec.cells_of(homes.get(row.name)) for row in rows}
    cells = {cell.name: cell for cell in spec.columns()}
    for row_cells in own_cells.values():
        cells.update({cell.name: cell for cell in row_cells if cell.name not in cells})
    return PanelLayout(
        rows=rows,
        homes=homes,
        cells=cells,
        cells_of={name: tuple(c.name for c in own) for name, own in own_cells.items()},
        reference=next((c.name for c in spec.columns() if c.kind == "reference"), None),
        family=spec.family,
        compare=spec.compare,
    )


def _training_steps(spec: PanelSpec) -> int:
    trained = next(unit for unit in units_of(spec) if unit.home is not None)
    return training_config(spec, trained).total_steps


def _policy(unit: Unit, held: Mapping[str, Evaluated]) -> dict[str, Any]:
    file = None if unit.home is None else f"policies/{unit.policy}/policy.zip"
    policy_hash = held[unit.policy].policy_hash
    return {"id": unit.policy, "seed": unit.seed, "hash": policy_hash, "file": file}


def cost_of(directory: RunDirectory, training: Sequence[str], workers: int) -> dict[str, Any]:
    """What a run took, interrupted runs included, s.

    Args:
        directory: of the run.
        training: names of its training units.
        workers: processes.
    """
    evaluation = sorted({there.unit for there in evaluated(directory).values()})
    return {
        "wall_seconds": round(directory.wall_seconds([*training, *evaluation]), 1),
        "workers": workers,
        "train_seconds": round(directory.seconds(training), 1),
        "evaluate_seconds": round(directory.seconds(evaluation), 1),
    }


def _whereabouts(
    entry: Mapping[str, Any], layout: PanelLayout, held: Mapping[str, Evaluated], path: Path
) -> dict[str, Any]:
    """Where the records behind an entry are, and the query that lists them."""
    row = next(row for row in layout.rows if row.name == entry["row"])
    files = list(dict.fromkeys(held[policy].file for policy in row.policies))
    policies = ", ".join(_quoted(policy) for policy in row.policies)
    sql = (
        "SELECT record_id, episode_index, success, failure_label FROM records "
        f"WHERE cell = {_quoted(entry['cell'])} AND policy_id IN ({policies})"
    )
    return {"file": files, "query": shlex.join(["integ-gym", "evidence", "query", str(path), sql])}


def _quoted(text: str) -> str:
    """A string literal of SQL."""
    return "'" + text.replace("'", "''") + "'"
