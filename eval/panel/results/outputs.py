"""From a finished panel's directory to ``panel.json``, the figures and the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from integ_gym.evidence import EvidenceStore

from ...report.figures import write_figures
from ...report.page import write_report
from ..model import Cost, Panel, Policy, write_panel
from ..running import Evaluated, RunDirectory, Unit, evaluated, training_config, units_of
from ..specification import Home, PanelSpec
from .artefact import Facts, build_artefact
from .engine_agreement import agreements
from .layout import PanelLayout
from .matrix import COLUMNS, Matrix, Row
from .training_cost import training_costs


def write_artefact(spec: PanelSpec, directory: RunDirectory, command: str, workers: int) -> Panel:
    """Reduce the evidence and write ``panel.json``, ``figures/`` and ``report.html``."""
    layout, units = layout_of(spec), units_of(spec)
    matrix = Matrix(layout.rows, evaluation_records(directory), spec.episodes)
    held = evaluated(directory)
    facts = facts_of(
        spec,
        directory,
        command,
        workers,
        {unit.policy: _policy(unit, held) for unit in units},
        training=[unit.training for unit in units],
        training_steps=_training_steps(spec),
        training_costs=training_costs(
            EvidenceStore(directory.evidence),
            {row.name: row.policies for row in layout.rows if row.kind == "trained"},
        ),
        engine_agreement=agreements(layout, matrix, spec),
    )
    panel = build_artefact(layout, matrix, facts)
    write_outputs(panel, directory)
    return panel


def facts_of(
    spec: PanelSpec,
    directory: RunDirectory,
    command: str,
    workers: int,
    policies: Mapping[str, Policy],
    /,
    *,
    training: Sequence[str] = (),
    **more: Any,
) -> Facts:
    """What a panel says beside its outcome.

    Args:
        spec: of the panel.
        directory: of the finished run.
        command: how to run it again, for the page.
        workers: processes.
        policies: by id.
        training: names of the run's training units.
        more: further attributes of :class:`Facts`, or others in place of these.
    """
    held = evaluated(directory)
    own = {
        "name": spec.name,
        "question": spec.question,
        "spec": spec.to_json(),
        "protocol_gaps": spec.gaps(),
        "command": command,
        "directory": str(directory.path),
        "versions": directory.versions(),
        "cost": cost_of(directory, training, workers),
        "policies": policies,
        "files": {policy: there.file for policy, there in held.items()},
    }
    return Facts(**{**own, **more})


def write_outputs(panel: Panel, directory: RunDirectory) -> None:
    """Write ``panel.json``, the figures and the page."""
    write_panel(panel, directory.path)
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


def _policy(unit: Unit, held: Mapping[str, Evaluated]) -> Policy:
    file = None if unit.home is None else f"policies/{unit.policy}/policy.zip"
    return Policy(id=unit.policy, seed=unit.seed, hash=held[unit.policy].policy_hash, file=file)


def cost_of(directory: RunDirectory, training: Sequence[str], workers: int) -> Cost:
    """What a run took, interrupted runs included.

    Args:
        directory: of the run.
        training: names of its training units.
        workers: processes.
    """
    evaluation = sorted({there.unit for there in evaluated(directory).values()})
    return Cost(
        wall_seconds=round(directory.wall_seconds([*training, *evaluation]), 1),
        workers=workers,
        train_seconds=round(directory.seconds(training), 1),
        evaluate_seconds=round(directory.seconds(evaluation), 1),
    )
