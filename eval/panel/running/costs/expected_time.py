"""What work is expected to take on one core, for progress bars and for dividing it."""

from __future__ import annotations

from integ_gym.envs.registries import ENGINES
from integ_gym.envs.settings import Discretization, Timing

from ...cells import Cell, Home, SpecError, is_engine
from ...spec import PanelSpec

DECISION_SECONDS = 4e-6
"""Time of one recorded decision, s."""

TASK_SECONDS = 1e-4
"""Time of one recorded decision in a testbed that advances lanes one by one, s."""

FOREIGN_STEP_SECONDS = 1e-5
"""Time of one step of an engine that advances lanes one by one, s."""

SEARCH_SECONDS = 1e-3
"""Time of one decision in the search over controls, whose lanes are side by side, s."""

TRAINING_SECONDS = 1e-5
"""Time of one decision of a training run, at least, s."""

LONGEST_DAYS, MOST_RUNS = 365.0, 10_000
"""A panel that takes longer on one core, or has more training runs, is refused."""


def check_cost(spec: PanelSpec) -> None:
    """Refuse a panel that nobody could wait for.

    Raises:
        SpecError: with what it would take.
    """
    runs = {home: len(spec.seeds_of(home)) for home in spec.train}
    playing = sum(count * _seconds_of(spec, home) for home, count in runs.items())
    playing += len(spec.baselines) * _seconds_of(spec, None)
    steps = spec.training.get("total_steps", 0)
    training = sum(runs.values()) * TRAINING_SECONDS * (steps if isinstance(steps, int) else 0)
    days = (playing + training) / 86400.0
    if days > LONGEST_DAYS or sum(runs.values()) > MOST_RUNS:
        raise SpecError(
            f"panel {spec.name!r} has {sum(runs.values())} training runs and "
            f"{spec.episodes} episodes in each cell, about {days:.3g} days of one core, and at "
            f"most {MOST_RUNS} runs and {LONGEST_DAYS:g} days are taken; give fewer seeds, cells "
            "or episodes, or a shorter `duration`"
        )


def _seconds_of(spec: PanelSpec, home: Home | None) -> float:
    return sum(cell_seconds(spec, cell) for cell in spec.cells_of(home))


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


def trying_seconds(spec: PanelSpec, cell: Cell) -> float:
    """Time of finding out whether a cell can be solved, from the starts that came last, s."""
    starts = len(spec.start_sets) * len(spec.latest) / spec.episodes
    searched = 0 if spec.testbed.horizon is None else cell_timing(spec, cell).horizon
    return searched * SEARCH_SECONDS + starts * cell_seconds(spec, cell)


def _engine_seconds(discretization: Discretization, substeps: int) -> float:
    """What one decision takes beside that of an engine that advances all lanes at once, s."""
    engine = discretization.engine
    if not is_engine(engine) or ENGINES.load(engine).batched:
        return 0.0
    return FOREIGN_STEP_SECONDS * substeps
