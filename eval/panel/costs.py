"""What a panel is expected to cost in time and storage, from measured rates, before it is run."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from integ_gym.envs.engines.stepping import is_engine
from integ_gym.envs.registries import ENGINES
from integ_gym.envs.settings import Discretization, Timing
from integ_gym.evidence.episodes import Layout

from .cells import Cell, Home, SpecError
from .elsewhere import all_cells
from .spec import PanelSpec
from .units import Unit, has_controller, trained_units, training_config

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
    """Refuse a panel that would take too long.

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
    starts = len(spec.start_sets) * len(spec.latest) / spec.episodes if has_controller(spec) else 0
    searched = 0 if spec.testbed.horizon is None else cell_timing(spec, cell).horizon
    return searched * SEARCH_SECONDS + starts * cell_seconds(spec, cell)


def _engine_seconds(discretization: Discretization, substeps: int) -> float:
    """What one decision takes beside that of an engine that advances all lanes at once, s."""
    engine = discretization.engine
    if not is_engine(engine) or ENGINES.load(engine).batched:
        return 0.0
    return FOREIGN_STEP_SECONDS * substeps


TRAINING_DECISION_SECONDS = {"PPO": 1.3e-4, "SAC": 7e-3}
"""Time of a decision of training with stable-baselines3, by algorithm, s: docs/how-to/fleet.md."""

ENTRY_BYTES = 2.7
"""Storage of one number of a trace; see docs/explanation/performance.md."""

RECORD_BYTES = 85.0
"""Storage of a record without its trace."""

FILE_BYTES = 70_000.0
"""Storage of a file of records with hardly any in it."""

BESIDE = 1.75
"""What a panel takes over the sum of its decisions: compilation, second horizons, its page.

It is the quick panel's time in the README over what would be computed without this.
"""

START_SECONDS = 9.0
"""Time of a panel beside training, trying and evaluating, s: Python's start and the page."""

COMPILE_SECONDS = 9.0
"""Time in which the fleet compiles the training of a row, s."""

CELL_SECONDS = 0.15
"""Time in which a cell's environments are made, compiled and committed from, by each worker, s."""

INTERPRETER_SECONDS = 4.0
"""Time in which an interpreter with other packages starts, for each worker, s."""

POLICY_BYTES = 20_000.0
"""Storage of a policy's files without its weights."""

WEIGHT_BYTES = 12.0
"""Storage of an actor's weight: in both files, and in one of them also the critic's like it."""


class ExpectedCost(NamedTuple):
    """What something costs.

    Attributes:
        train_seconds: of one core.
        evaluate_seconds: of one core.
        storage: bytes.
    """

    train_seconds: float
    evaluate_seconds: float
    storage: float

    @property
    def seconds(self) -> float:
        """Of one core, altogether."""
        return self.train_seconds + self.evaluate_seconds

    def times(self, count: float) -> ExpectedCost:
        """That of so many."""
        return ExpectedCost(*(count * one for one in self))


def total_cost(costs: Sequence[ExpectedCost]) -> ExpectedCost:
    """Of all together."""
    return ExpectedCost(*map(sum, zip(ExpectedCost(0.0, 0.0, 0.0), *costs, strict=True)))


def policy_costs(spec: PanelSpec) -> list[ExpectedCost]:
    """Cost of every policy that a panel trains, its evaluation in all its cells included."""
    by_home: dict[Home | None, ExpectedCost] = {}
    units = trained_units(spec)
    for unit in units:
        if unit.home not in by_home:
            by_home[unit.home] = total_cost([_training(spec, unit), _evaluation(spec, unit.home)])
    return [by_home[unit.home] for unit in units]


def fixed_cost(spec: PanelSpec, workers: int = 1) -> ExpectedCost:
    """Cost of what a panel does however many policies it trains: it starts, compiles and tries.

    Args:
        spec: the panel.
        workers: processes, each of which makes every cell's environments.
    """
    baselines = _evaluation(spec, None).times(len(spec.baselines))
    cells, columns = all_cells(spec), spec.columns()
    interpreters = {cell.packages for cell in cells if cell.packages}
    seconds = START_SECONDS + sum(trying_seconds(spec, cell) for cell in columns)
    seconds += CELL_SECONDS * (workers * len(cells) + len(columns))
    seconds += INTERPRETER_SECONDS * workers * len(interpreters)
    compiling = COMPILE_SECONDS * len(spec.train) if spec.trainer == "fleet" else 0.0
    storage = FILE_BYTES + _tried_bytes(spec)
    return total_cost([baselines, ExpectedCost(compiling, seconds, storage)])


def _tried_bytes(spec: PanelSpec) -> float:
    """Storage of a hand-made controller's attempts: a file for each cell, with one trace."""
    if not has_controller(spec):
        return 0.0
    cells, attempts = spec.columns(), len(spec.start_sets) * spec.episodes
    return len(cells) * FILE_BYTES + _record_bytes(spec, cells, attempts, 1.0)


def _record_bytes(spec: PanelSpec, cells: Sequence[Cell], episodes: int, traces: float) -> float:
    """Storage of so many episodes in each cell, so many of them with a trace; no files' heads."""
    layout = len(Layout(spec.nominal.plant, spec.nominal.task))
    steps = sum(cell_timing(spec, cell).horizon + 1 for cell in cells)
    return len(cells) * episodes * RECORD_BYTES + traces * ENTRY_BYTES * layout * steps


def _training(spec: PanelSpec, unit: Unit) -> ExpectedCost:
    config: Any = training_config(spec, unit)
    layout = len(Layout(spec.nominal.plant, spec.nominal.task))
    timing = spec.nominal.timing
    episodes = config.rounded_steps / timing.horizon
    records = episodes * RECORD_BYTES + ENTRY_BYTES * layout * (
        config.rounded_steps / config.trace_every
    )
    sizes = (len(spec.nominal.task.observation_names), *config.net_arch, 1)
    weights = sum(a * b for a, b in pairwise(sizes))
    files = FILE_BYTES + POLICY_BYTES + WEIGHT_BYTES * weights
    return ExpectedCost(BESIDE * _training_seconds(spec, config), 0.0, records + files)


def _training_seconds(spec: PanelSpec, config: Any) -> float:
    if spec.trainer != "fleet":
        return float(config.rounded_steps) * TRAINING_DECISION_SECONDS[config.algorithm]
    from integ_gym.train.fleet.planning import training_seconds

    return training_seconds(config)


def _evaluation(spec: PanelSpec, home: Home | None) -> ExpectedCost:
    cells = spec.cells_of(home)
    seconds = sum(cell_seconds(spec, cell) for cell in cells)
    storage = _record_bytes(spec, cells, spec.episodes, spec.episodes / spec.trace_every)
    return ExpectedCost(0.0, BESIDE * seconds, storage)
