"""Evaluation of a policy that exists already, over the built-in discretizations."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from integ_gym.envs.environment import action_space, observation_space
from integ_gym.envs.integrators import INTEGRATORS
from integ_gym.envs.registration import environment_setup
from integ_gym.envs.vector import DISCRETIZATION
from integ_gym.eval.artefact import Layout, build_artefact
from integ_gym.eval.evaluation import Conditions, Subject, evaluate
from integ_gym.eval.matrix import Matrix, Row
from integ_gym.eval.panel_artefact import evaluation_records, whereabouts, write_outputs
from integ_gym.eval.run_directory import RunDirectory, key_of
from integ_gym.eval.spec import Cell, Discretization, PanelSpec
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.baselines import make_baseline
from integ_gym.train.policy import MlpPolicy
from integ_gym.train.sb3_zip import read_observation_statistics, read_sb3_zip
from integ_gym.train.sidecar import read_trained

STOCK_ARGUMENTS: Mapping[str, Mapping[str, Any]] = {
    "IntegPendulum-v0": {"max_speed": 8.0},
    "IntegCartPole-v0": {},
}
"""What makes an environment Gymnasium's own at its default discretization."""

BASELINES = ("random", "zero", "handmade")
REFINEMENTS = (1, 2, 4)


@dataclass(frozen=True)
class Existing:
    """A policy and what is known of its training.

    Attributes:
        policy: what acts.
        home: discretization it was trained on.
        environment: constructor arguments of its training environment, without the discretization.
        origin: where the two come from, in words.
    """

    policy: MlpPolicy
    home: Discretization
    environment: Mapping[str, Any]
    origin: str


@dataclass(frozen=True)
class Grid:
    """The discretizations to evaluate on; the reference always comes with them.

    Attributes:
        integrators: names; by default all but the reference.
        dts: steps, s; by default the control period, half and a quarter of it.
        episodes: paired starts.
        episode_seed: seed of episode 0.
    """

    integrators: Sequence[str] = ()
    dts: Sequence[float] = ()
    episodes: int = 50
    episode_seed: int = 1000
    environment: Mapping[str, Any] = field(default_factory=dict)


def load(path: Path, obs_stats: Path | None = None) -> tuple[MlpPolicy, dict[str, Any] | None]:
    """A policy and its side-car, the JSON file of the same name; None where there is none.

    Raises:
        PolicyFileError: for a file that cannot be read, or a side-car of another policy.
    """
    if not path.with_suffix(".json").exists():
        return read_sb3_zip(path, obs_stats=obs_stats), None
    policy, card = read_trained(path)
    if obs_stats is not None:
        policy = replace(policy, statistics=read_observation_statistics(obs_stats))
    return policy, card


def describe(
    policy: MlpPolicy, card: Mapping[str, Any] | None, env_id: str, given: Mapping[str, Any]
) -> Existing:
    """What is known of a policy's training: its side-car, or else the stock environment.

    Args:
        policy: the policy.
        card: its side-car, or None.
        env_id: environment to evaluate in.
        given: environment arguments that override both; not the discretization, which is what
            the evaluation varies.

    Raises:
        ValueError: if the side-car is of another environment or of a mixture, or if ``given``
            holds what the evaluation varies.
    """
    for name in DISCRETIZATION:
        if name in given:
            raise ValueError(
                f"`{name}` is what the evaluation varies, and the policy's home comes from its "
                "side-car; leave it out of --env-arg and choose cells with --integrator and --dt"
            )
    if card is None:
        arguments = dict(STOCK_ARGUMENTS.get(env_id, {}))
        origin = "no side-car: Gymnasium's own environment is taken as its home"
    else:
        arguments = _trained_on(card, env_id)
        origin = "the side-car beside the policy"
    arguments.update(given)
    setup = environment_setup(env_id, arguments)
    home = Discretization(
        setup.settings.integrator,
        setup.settings.dt,
        setup.timing.control_period,
        setup.settings.engine,
    )
    environment = {name: v for name, v in arguments.items() if name not in home.arguments()}
    policy.check_spaces(observation_space(setup), action_space(setup))
    return Existing(policy, home, environment, origin)


def row_name(path: Path) -> str:
    """Name of a policy's row and of its files: that of its file, kept apart from the baselines'."""
    name = re.sub(r"[^A-Za-z0-9._]+", "-", path.stem).strip("-._")[:100] or "policy"
    return f"policy-{name}" if name in BASELINES else name


def plan(existing: Existing, env_id: str, grid: Grid) -> PanelSpec:
    """The evaluation as a panel without training, all its cells checked.

    Raises:
        TypeError, ValueError: for a cell that cannot be made.
    """
    spec = _specification(existing, env_id, grid)
    for cell in spec.columns():
        environment_setup(env_id, cell.arguments(spec.environment))
    return spec


def work(spec: PanelSpec) -> int:
    """Cells that :func:`evaluate_existing` runs, baselines included."""
    return len(spec.columns()) * (1 + len(BASELINES))


def evaluate_existing(
    existing: Existing,
    spec: PanelSpec,
    out: Path,
    command: str,
    on_cell: Callable[[], None] = lambda: None,
) -> dict[str, Any]:
    """Evaluate a policy and two baselines, and write the usual directory.

    Args:
        existing: the policy.
        spec: what :func:`plan` made.
        out: directory.
        command: how to run this again, for the page.
        on_cell: called after every cell.

    Returns:
        The content of ``panel.json``; ``warnings`` lists what casts doubt on the result.

    Raises:
        RunDirectoryError: for a directory that holds something else.
    """
    row = existing.policy.policy_id
    directory = RunDirectory(out, {**spec.to_json(), "policy": existing.policy.content_hash})
    start = time.time()
    subjects = {row: Subject(existing.policy, existing.home)}
    nominal = environment_setup(spec.env_id, {**existing.environment, **spec.reference.arguments()})
    subjects |= {name: Subject(make_baseline(name, nominal)) for name in BASELINES}
    cells = _cells(spec, existing.home)
    with directory.opened():
        for name, subject in subjects.items():
            _evaluate_once(name, subject, cells, spec, directory, on_cell)
    layout = _layout(row, existing, spec, cells)
    matrix = Matrix(layout.rows, evaluation_records(directory), spec.episodes)
    panel = build_artefact(layout, matrix, _facts(existing, spec, directory, command, start))
    panel["warnings"] = _warnings(matrix, row, existing.home.name)
    for entry in panel["matrix"]:
        entry.update(whereabouts(entry, layout, directory.path))
    write_outputs(panel, directory.path)
    return panel


def _trained_on(card: Mapping[str, Any], env_id: str) -> dict[str, Any]:
    config = card["config"]
    if config["env_id"] != env_id:
        raise ValueError(
            f"the policy was trained on {config['env_id']}; evaluate it with --env "
            f"{config['env_id']}"
        )
    arguments = dict(config["env_arguments"])
    if "mixture" in arguments:
        raise ValueError(
            "the policy was trained on a mixture of discretizations and has no single home; "
            "evaluate it in a panel, or without its side-car"
        )
    return arguments


def _specification(existing: Existing, env_id: str, grid: Grid) -> PanelSpec:
    home = existing.home
    period = home.control_period
    integrators = grid.integrators or [n for n in INTEGRATORS.names() if n != "reference"]
    dts = grid.dts or [period / n for n in REFINEMENTS]
    columns = [Discretization(i, dt, period, home.engine) for i in integrators for dt in dts]
    return PanelSpec(
        name=f"evaluate {existing.policy.policy_id}",
        env_id=env_id,
        control_period=period,
        train=(),
        grid=tuple(dict.fromkeys([*columns, home])),
        seeds=(),
        environment=existing.environment,
        baselines=BASELINES,
        ladder=False,
        episodes=grid.episodes,
        episode_seed=grid.episode_seed,
        question=f"Does {existing.policy.policy_id} survive another integrator or timestep?",
    )


def _cells(spec: PanelSpec, home: Discretization) -> tuple[Cell, ...]:
    return tuple(sorted(spec.columns(), key=lambda cell: cell.discretization != home))


def _evaluate_once(
    name: str,
    subject: Subject,
    cells: Sequence[Cell],
    spec: PanelSpec,
    directory: RunDirectory,
    on_cell: Callable[[], None],
) -> None:
    unit = f"evaluate-{name}"
    key = key_of(spec=spec.to_json(), policy=subject.policy.content_hash)
    if directory.finished(unit, key):
        return
    directory.discard_remains(unit)
    conditions = Conditions(
        spec.name, spec.env_id, spec.environment, spec.episodes, spec.episode_seed
    )
    named = replace(subject, policy=_named(subject.policy, name))
    evaluate(named, cells, conditions, EvidenceStore(directory.evidence), unit, on_cell)
    directory.finish(unit, key, policy=subject.policy.content_hash)


def _named(policy: Any, name: str) -> Any:
    return replace(policy, policy_id=name) if isinstance(policy, MlpPolicy) else policy


def _layout(row: str, existing: Existing, spec: PanelSpec, cells: Sequence[Cell]) -> Layout:
    names = tuple(cell.name for cell in cells)
    rows = (
        Row(row, "given", (row,), existing.home.name),
        *(Row(name, "baseline", (name,)) for name in BASELINES),
    )
    return Layout(
        rows=rows,
        homes={row: existing.home},
        cells={cell.name: cell for cell in spec.columns()},
        cells_of={r.name: names for r in rows},
        reference=spec.columns()[-1].name,
    )


def _facts(
    existing: Existing, spec: PanelSpec, directory: RunDirectory, command: str, start: float
) -> dict[str, Any]:
    row = existing.policy.policy_id
    hashes = {row: existing.policy.content_hash}
    return {
        "name": spec.name,
        "question": spec.question,
        "spec": {**spec.to_json(), "home": existing.origin},
        "command": command,
        "directory": str(directory.path),
        "training_steps": None,
        "policies": {
            name: {"id": name, "seed": None, "hash": hashes.get(name), "file": None}
            for name in (row, *BASELINES)
        },
        "cost": {
            "wall_seconds": round(time.time() - start, 1),
            "workers": 1,
            "train_seconds": 0.0,
            "evaluate_seconds": round(time.time() - start, 1),
        },
    }


def _warnings(matrix: Matrix, row: str, home: str) -> list[str]:
    """Doubt where the policy is no better than random on its own discretization."""
    own = matrix.values(row, home, "return")[0]
    random = matrix.values("random", home, "return")[0]
    difference = own - random
    error = float(difference.std(ddof=1)) / math.sqrt(len(difference)) if len(own) > 1 else 0.0
    if difference.mean() > 2.0 * error and np.isfinite(difference).all():
        return []
    return [
        f"on its home discretization ({home}) the policy's return {own.mean():.1f} is no better "
        f"than random's {random.mean():.1f}; trained with VecNormalize? pass --obs-stats FILE.json"
    ]
