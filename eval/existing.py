"""Evaluation of a policy that exists already, over the built-in discretizations."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy.typing as npt

from integ_gym.envs.environment import action_space, observation_space
from integ_gym.envs.integrators import INTEGRATORS
from integ_gym.envs.mixture import DISCRETIZATION, Mixture
from integ_gym.envs.registration import environment_mixture, environment_setup
from integ_gym.eval.artefact import build_artefact
from integ_gym.eval.cells import (
    Cell,
    Discretization,
    DiscretizationMixture,
    Home,
    dividing_step,
)
from integ_gym.eval.engine_cells import NATIVE
from integ_gym.eval.evaluation import Subject, conditions_of, outcomes_in
from integ_gym.eval.evaluation_units import batches_of, evaluate_batch, not_evaluated
from integ_gym.eval.matrix import Matrix, Row
from integ_gym.eval.panel import nominal_setup
from integ_gym.eval.panel_artefact import (
    cost_of,
    evaluation_records,
    make_layout,
    shares_of,
    write_outputs,
)
from integ_gym.eval.panel_layout import PanelLayout
from integ_gym.eval.run_directory import RunDirectory
from integ_gym.eval.spec import BASELINES, PanelSpec, standard_perturbations
from integ_gym.evidence.atomic import replace_file
from integ_gym.train.baselines import make_baseline
from integ_gym.train.policy import MlpPolicy, Policy
from integ_gym.train.sb3_zip import read_observation_statistics, read_sb3_zip
from integ_gym.train.sidecar import POLICY_FILE, SIDECAR_FILE, has_sidecar, read_trained

Array = npt.NDArray[Any]

STOCK_ARGUMENTS: Mapping[str, Mapping[str, Any]] = {
    "IntegPendulum-v0": {"max_speed": 8.0},
    "IntegCartPole-v0": {},
}
"""What makes an environment Gymnasium's own at its default discretization."""

STATISTICS_FILE = "obs_stats.json"

REFINEMENTS = (1, 2, 4)


@dataclass(frozen=True)
class Existing:
    """A policy and what is known of its training.

    Attributes:
        policy: what acts.
        home: discretization or mixture that it was trained on.
        environment: constructor arguments of its training environment, without the discretization.
        origin: where the two come from, in words.
        files: what it was read from, by the name to keep it under.
        seed: of its training, where it is known.
    """

    policy: MlpPolicy
    home: Home
    environment: Mapping[str, Any]
    origin: str
    files: Mapping[str, Path] = field(default_factory=dict)
    seed: int | None = None


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


def read_existing(
    path: Path,
    env_id: str,
    given: Mapping[str, Any],
    obs_stats: Path | None = None,
    own_code: bool = False,
) -> Existing:
    """A policy from its file, with what its side-car says.

    See :func:`load_policy` and :func:`describe`.

    Args:
        path: the zip that SB3 wrote.
        env_id: environment to evaluate in.
        given: environment arguments that override those of its training.
        obs_stats: JSON file of VecNormalize's statistics.
        own_code: see :func:`describe`.
    """
    policy, card = load_policy(path, obs_stats)
    name = path.stem if card is None else str(card.get("policy_id", path.stem))
    files = {POLICY_FILE: path}
    files |= {} if card is None else {SIDECAR_FILE: path.with_suffix(".json")}
    files |= {} if obs_stats is None else {STATISTICS_FILE: obs_stats}
    named = replace(policy, policy_id=row_name(name))
    existing = describe(named, card, env_id, given, own_code)
    return replace(existing, files=files, seed=None if card is None else card.get("seed"))


def load_policy(
    path: Path, obs_stats: Path | None = None
) -> tuple[MlpPolicy, dict[str, Any] | None]:
    """A policy and its side-car, the JSON file of the same name; None where there is none.

    Raises:
        PolicyFileError: for a file that cannot be read, or a side-car of another policy.
    """
    if not has_sidecar(path):
        return read_sb3_zip(path, obs_stats=obs_stats), None
    policy, card = read_trained(path)
    if obs_stats is not None:
        policy = replace(policy, statistics=read_observation_statistics(obs_stats))
    return policy, card


def describe(
    policy: MlpPolicy,
    card: Mapping[str, Any] | None,
    env_id: str,
    given: Mapping[str, Any],
    own_code: bool = False,
) -> Existing:
    """What is known of a policy's training: its side-car, or else the stock environment.

    Args:
        policy: the policy.
        card: its side-car, or None.
        env_id: environment to evaluate in.
        given: environment arguments that override both; not the discretization, which is what
            the evaluation varies.
        own_code: whether a class that the side-car names as ``"module:Class"`` may be loaded.

    Raises:
        ValueError: if the side-car is damaged or of another environment, or names code that may
            not be run; or if ``given`` holds what the evaluation varies.
    """
    for name in (*DISCRETIZATION, "mixture"):
        if name in given:
            raise ValueError(
                f"`{name}` is what the evaluation varies, and the policy's home comes from its "
                "side-car; leave it out of --env-arg and choose cells with --integrator and --dt"
            )
    if card is None:
        arguments = dict(STOCK_ARGUMENTS.get(env_id, {}))
        origin = "no side-car: Gymnasium's own environment is taken as its home"
    else:
        arguments = _trained_on(card, env_id, own_code)
        origin = "the side-car beside the policy"
    arguments.update(given)
    mixture = environment_mixture(env_id, arguments)
    varied = (*DISCRETIZATION, "mixture")
    environment = {name: value for name, value in arguments.items() if name not in varied}
    setup = mixture.setups[0]
    policy.check_spaces(observation_space(setup), action_space(setup))
    return Existing(policy, _home(mixture), environment, origin)


def _home(mixture: Mixture) -> Home:
    """What a training environment's episodes run on, a discretization named twice counted once."""
    weights: dict[Discretization, float] = {}
    for setup, share in zip(mixture.setups, mixture.shares, strict=True):
        settings = setup.settings
        member = Discretization(
            settings.integrator, settings.dt, setup.timing.control_period, settings.engine
        )
        weights[member] = weights.get(member, 0.0) + float(share)
    if len(weights) == 1:
        return next(iter(weights))
    return DiscretizationMixture("its mixture", tuple(weights.items()))


def row_name(name: str) -> str:
    """A policy's name as that of its row and files, kept apart from the baselines'."""
    usable = re.sub(r"[^A-Za-z0-9._]+", "-", name).strip("-._")[:100] or "policy"
    return f"policy-{usable}" if usable in BASELINES else usable


def plan(existing: Existing, env_id: str, grid: Grid) -> PanelSpec:
    """The evaluation as a panel without training, all its cells checked.

    A baseline that cannot be made for the environment, such as a hand-made controller without
    gravity, is left out.

    Raises:
        TypeError, ValueError: for a cell that cannot be made.
    """
    spec = _specification(existing, env_id, grid)
    for cell in spec.columns():
        environment_setup(env_id, cell.arguments(spec.environment))
    possible = tuple(name for name in BASELINES if _can_be_made(name, spec))
    return replace(spec, baselines=possible)


def _can_be_made(baseline: str, spec: PanelSpec) -> bool:
    try:
        make_baseline(baseline, nominal_setup(spec))
    except ValueError:
        return False
    return True


def work(spec: PanelSpec, home: Home) -> int:
    """Cells that :func:`evaluate_existing` runs, added up over the policy and the baselines."""
    return len(spec.cells_of(home)) + len(spec.baselines) * len(spec.cells_of(None))


def doubts(existing: Existing, spec: PanelSpec) -> list[str]:
    """Doubt where the policy is no better than random on its own discretization."""
    home, conditions = Cell(_main(existing.home), "grid"), conditions_of(spec)
    random = make_baseline("random", nominal_setup(spec))
    own, chance = outcomes_in(home, [existing.policy, random], conditions).returns
    return doubts_of(existing, home.name, own, chance)


def doubts_of(existing: Existing, home: str, own: Array, chance: Array) -> list[str]:
    """Doubt where a policy is no better than random.

    Args:
        existing: the policy.
        home: name of its home cell.
        own: its returns there, shape (episodes,).
        chance: those of the random policy from the same starts.
    """
    difference = own - chance
    error = float(difference.std(ddof=1)) / math.sqrt(len(difference)) if len(own) > 1 else 0.0
    if difference.mean() > 2.0 * error:
        return []
    better = "no better than" if difference.mean() <= 0 else "not shown to be better than"
    remedy = (
        "trained with VecNormalize? pass --obs-stats FILE.json"
        if existing.seed is None
        else "was it trained for long enough?"
    )
    return [
        f"on its home discretization ({home}) the policy's return {own.mean():.1f} over "
        f"{len(own)} episodes is {better} random's {chance.mean():.1f}; {remedy}"
    ]


def evaluate_existing(
    existing: Existing,
    spec: PanelSpec,
    out: Path,
    command: str,
    on_cell: Callable[[int], None] = lambda policies: None,
    on_doubt: Callable[[str], None] = lambda doubt: None,
) -> dict[str, Any]:
    """Evaluate a policy and the baselines, and write the usual directory.

    Args:
        existing: the policy.
        spec: what :func:`plan` made.
        out: directory.
        command: how to run this again, for the page.
        on_cell: told after every cell how many policies were in it.
        on_doubt: called first, with each sentence that casts doubt on the result.

    Returns:
        The content of ``panel.json``; ``warnings`` lists the doubts.

    Raises:
        RunDirectoryError: for a directory that holds something else.
    """
    directory = directory_of(existing, spec, out)
    baselines = [make_baseline(name, nominal_setup(spec)) for name in spec.baselines]
    with directory.opened():
        warnings = doubts(existing, spec)
        for doubt in warnings:
            on_doubt(doubt)
        for batch in batches_of(spec, begin(existing, spec, directory, baselines, on_cell), 1):
            evaluate_batch(spec, directory, batch, lambda _, policies: on_cell(policies))
        layout, matrix = outcome(existing, spec, directory)
        panel = build_artefact(layout, matrix, facts_of(existing, spec, directory, command))
        panel["warnings"] = warnings
        write_outputs(panel, layout, directory)
    return panel


def directory_of(existing: Existing, spec: PanelSpec, out: Path) -> RunDirectory:
    """The directory of one policy's evaluation; another policy in it is refused."""
    content = {**spec.to_json(), "policy": existing.policy.content_hash}
    return RunDirectory(out, content, spec.engine_versions())


def begin(
    existing: Existing,
    spec: PanelSpec,
    directory: RunDirectory,
    baselines: Sequence[Policy],
    on_cell: Callable[[int], None],
) -> list[Subject]:
    """Keep the policy's files, and tell which of the policies have not been evaluated yet.

    Args:
        existing: the policy.
        spec: the evaluation.
        directory: held by the caller.
        baselines: policies beside it.
        on_cell: told how many cells are done already.
    """
    for name, source in existing.files.items():
        replace_file(directory.policies / existing.policy.policy_id / name, source.read_bytes())
    subjects = [
        Subject(existing.policy, spec.cells_of(existing.home), existing.home),
        *(Subject(baseline, spec.cells_of(None)) for baseline in baselines),
    ]
    waiting = not_evaluated(spec, directory, subjects)
    on_cell(sum(len(subject.cells) for subject in subjects if subject not in waiting))
    return waiting


def outcome(
    existing: Existing, spec: PanelSpec, directory: RunDirectory
) -> tuple[PanelLayout, Matrix]:
    """Rows and cells of a finished evaluation, and what came out."""
    homes = {existing.policy.policy_id: existing.home}
    layout = make_layout(spec, _rows(existing, spec), homes)
    return layout, Matrix(layout.rows, evaluation_records(directory), spec.episodes)


def _trained_on(card: Mapping[str, Any], env_id: str, own_code: bool) -> dict[str, Any]:
    """Environment arguments of the training."""
    config = card.get("config")
    given = config.get("env_arguments") if isinstance(config, Mapping) else None
    if not isinstance(config, Mapping) or not isinstance(given, Mapping):
        raise ValueError(
            "the policy's side-car does not say what it was trained on; restore the file that the "
            "trainer wrote, or move it away to take Gymnasium's own environment as the home"
        )
    if config.get("env_id") != env_id:
        raise ValueError(
            f"the policy was trained on {config.get('env_id')}; evaluate it with --env "
            f"{config.get('env_id')}"
        )
    arguments = dict(given)
    foreign = [text for text in _texts(arguments) if ":" in text]
    if foreign and not own_code:
        raise ValueError(
            f"the policy's side-car names {foreign[0]!r}, whose code would be run; if it is yours, "
            "pass --own-code"
        )
    return arguments


def _texts(value: Any) -> list[str]:
    """All texts in plain data, keys left out."""
    if isinstance(value, str):
        return [value]
    inner = value.values() if isinstance(value, Mapping) else value
    return [t for x in inner for t in _texts(x)] if isinstance(inner, Iterable) else []


def _main(home: Home) -> Discretization:
    """The discretization that most of the training ran on, the first of equals."""
    return max(home.shares, key=lambda member: home.shares[member])


def _specification(existing: Existing, env_id: str, grid: Grid) -> PanelSpec:
    home = _main(existing.home)
    period = home.control_period
    ours = [n for n in INTEGRATORS.names() if n != "reference"]
    integrators, engine = (grid.integrators, home.engine) if grid.integrators else (ours, NATIVE)
    coarsest = dividing_step({**existing.environment, "dt": period})
    dts = grid.dts or [coarsest / n for n in REFINEMENTS]
    columns = [Discretization(i, dt, period, engine) for i in integrators for dt in dts]
    return PanelSpec(
        name=f"evaluate {existing.policy.policy_id}",
        env_id=env_id,
        control_period=period,
        train=(),
        grid=tuple(dict.fromkeys([*columns, *existing.home.shares])),
        seeds=(),
        environment=existing.environment,
        perturbations=standard_perturbations(
            env_id, Cell(home, "grid").arguments(existing.environment)
        ),
        ladder=False,
        episodes=grid.episodes,
        episode_seed=grid.episode_seed,
        question=f"Does {existing.policy.policy_id} survive another integrator or timestep?",
    )


def _rows(existing: Existing, spec: PanelSpec) -> tuple[Row, ...]:
    row = existing.policy.policy_id
    return (
        Row(row, "given", (row,), shares_of(existing.home)),
        *(Row(name, "baseline", (name,)) for name in spec.baselines),
    )


def facts_of(
    existing: Existing, spec: PanelSpec, directory: RunDirectory, command: str, workers: int = 1
) -> dict[str, Any]:
    """What the artefact says of the evaluation beside its outcome."""
    row = existing.policy.policy_id
    return {
        "name": spec.name,
        "question": spec.question,
        "spec": {**spec.to_json(), "home": existing.origin},
        "protocol_gaps": spec.gaps(),
        "command": command,
        "directory": str(directory.path),
        "training_steps": None,
        "policies": {
            row: {
                "id": row,
                "seed": existing.seed,
                "hash": existing.policy.content_hash,
                "file": f"policies/{row}/{POLICY_FILE}",
            },
            **{
                name: {"id": name, "seed": None, "hash": None, "file": None}
                for name in spec.baselines
            },
        },
        "cost": cost_of(directory, [], workers),
    }
