"""What work is expected to take on one core, for progress bars and for dividing it."""

from __future__ import annotations

from integ_gym.envs import ENGINES, Discretization, Timing

from ..specification import Cell, PanelSpec

DECISION_SECONDS = 4e-6
"""Time of one recorded decision, s."""

TASK_SECONDS = 1e-4
"""Time of one recorded decision in a testbed that advances lanes one by one, s."""

FOREIGN_STEP_SECONDS = 1e-5
"""Time of one step of an engine that advances lanes one by one, s."""


def cell_timing(spec: PanelSpec, cell: Cell) -> Timing:
    """Sub-steps and horizon in a cell; no engine is built for it."""
    given = {"duration": spec.nominal.settings.duration, **cell.arguments(spec.environment)}
    return Timing.of(given["dt"], given["control_period"], 0.0, None, given["duration"])


def cell_seconds(spec: PanelSpec, cell: Cell) -> float:
    """Time of one policy's episodes in a cell, s, without second horizons: who fails is unknown."""
    timing = cell_timing(spec, cell)
    recorded = DECISION_SECONDS if spec.testbed.batched else TASK_SECONDS
    decision = recorded + _engine_seconds(cell.discretization, timing.substeps)
    return spec.episodes * timing.horizon * decision


def _engine_seconds(discretization: Discretization, substeps: int) -> float:
    """What one decision takes beside that of an engine that advances all lanes at once, s."""
    if ENGINES.load(discretization.engine).batched:
        return 0.0
    return FOREIGN_STEP_SECONDS * substeps
