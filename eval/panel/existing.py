"""The evaluation of an existing policy: a panel without training around it."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType, SimpleNamespace
from typing import Annotated, Any

import msgspec
import numpy as np

from integ_gym.envs.settings import Discretization
from integ_gym.envs.testbeds.gym_testbed import Testbed
from integ_gym.envs.testbeds.making import find_testbed
from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.errors import InputError, InputTypeError
from integ_gym.support.executors import Cluster, Resources, open_cluster
from integ_gym.support.files import display_path, replace_file
from integ_gym.support.interpreters import PACKAGES
from integ_gym.support.optional import installed_versions, require
from integ_gym.support.parameters import unknown_name
from integ_gym.support.processes import check_spawning, cores
from integ_gym.support.storage import Storage, open_storage
from integ_gym.support.terminal import print_wrapped
from integ_gym.train.baselines import possible_baselines
from integ_gym.train.policy_files.hub import fetch_file, is_on_hub
from integ_gym.train.policy_files.reading import unscaled
from integ_gym.train.policy_files.sidecar import Stated

from .cells import (
    Count,
    Name,
    SpecError,
    Variation,
    convert,
    environments_of,
    evaluation_cells,
    fitting,
    main_home,
    many,
    standard_variations,
    vary,
)
from .checking.plan import check_records
from .doubts import doubts_of
from .elsewhere import make_interpreters
from .episodes import Subject
from .evaluate import all_seconds, evaluate_all
from .home import VARIED, Provenance, provenance
from .limit import choose_steps
from .matrix import given_rows
from .outputs import CHECKING, JUDGING, Call, artefact_of, phases, reduce_records, write_outputs
from .plan import read_planned_home
from .policies import (
    Existing,
    find_policy,
    given_policy,
    is_reference,
    read_existing,
    read_policy_file,
)
from .result import Panel
from .result import Policy as PanelPolicy
from .run import as_there, resources_for
from .run_directory import GIVEN, MANIFEST, RunDirectory, Seen
from .spec import TRAINERS, PanelSpec, check_cells, read_toml
from .units import baseline_of


class Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is known of a policy beside its hash and its home.

    Attributes:
        seed: of its training; None: not known.
        file: in its folder of the run; None for what came as an object.
        unscaled: whether it learned from scaled observations, and is given them as they are.
        statistics: whether it scales observations itself.
        bounds: of its actions, low and high; None: not known.
        overridden: arguments of its training in place of which others were given.
    """

    seed: int | None
    file: str | None
    unscaled: bool
    statistics: bool
    bounds: tuple[list[float], list[float]] | None
    overridden: dict[str, Any]


def facts_of(existing: Existing) -> dict[str, Any]:
    """What a run's manifest keeps of a policy."""
    facts = Facts(
        existing.seed,
        next(iter(existing.files), None),
        existing.unscaled,
        *_of_actions(existing.policy),
        dict(existing.provenance.overridden),
    )
    return dict(msgspec.to_builtins(facts))


def build_given_panel(spec: PanelSpec, directory: RunDirectory, called: Call) -> Panel:
    """What ``panel.json`` holds of an evaluation: a function of its manifest and records alone.

    Args:
        spec: of the evaluation.
        directory: of the run, all of which is there.
        called: how the run was called.

    Raises:
        ValueError: where the manifest does not say what is known of the policy.
    """
    existing = _find_existing(spec, directory)
    name = existing.policy.policy_id
    file = next((f"policies/{name}/{kept}" for kept in existing.files), None)
    policy = PanelPolicy(id=name, seed=existing.seed, hash=existing.policy.content_hash, file=file)
    rows, homes = given_rows(spec, policy, existing.home)
    layout, matrix = reduce_records(spec, directory, rows, homes)
    doubts = doubts_of(existing, spec, layout, matrix, EvidenceStore(directory.evidence))
    found = {"looks": layout.looks, "doubts": doubts}
    return artefact_of(spec, directory, layout, matrix, called, (), **found)


def other_facts(
    spec: PanelSpec, directory: RunDirectory, own_code: bool
) -> Iterator[tuple[str, Any, Any]]:
    """What a run says of a policy and its file does not: name, what is said, what is read.

    Raises:
        ValueError: for a file that cannot be read, or a manifest without this.
    """
    existing, said = _find_existing(spec, directory), _facts(directory)
    folder = directory.policies / existing.policy.policy_id
    found = find_policy(folder)
    if found is None:
        if said.file is not None:
            yield "file", said.file, None
        return
    path, statistics = found
    policy, card, _ = read_policy_file(path, statistics)
    overridden = said.overridden
    if card is not None and existing.provenance.origin.startswith("the side-car"):
        given = {name: x for name, x in spec.environment.items() if name not in VARIED}
        overridden = dict(provenance(spec.env_id, card, None, given, own_code)[0].overridden)
    facts = Facts(
        None if card is None else card.get("seed"),
        path.name,
        statistics is None and unscaled(path, card),
        *_of_actions(policy),
        overridden,
    )
    one, other = msgspec.to_builtins(said), msgspec.to_builtins(facts)
    yield from ((name, one[name], other[name]) for name in one if one[name] != other[name])


def _of_actions(policy: Any) -> tuple[bool, tuple[list[float], list[float]] | None]:
    """Whether a policy scales observations, and the bounds of its actions."""
    bounds: Any = getattr(policy, "bounds", None)
    if bounds is not None:
        bounds = tuple(np.asarray(end, dtype=np.float64).tolist() for end in bounds)
    return getattr(policy, "statistics", None) is not None, bounds


def _facts(directory: RunDirectory) -> Facts:
    try:
        return msgspec.convert(directory.manifest().get(GIVEN), Facts)
    except msgspec.ValidationError as error:
        raise InputError(f"its {MANIFEST} does not say what the policy is ({error})") from None


def _find_existing(spec: PanelSpec, directory: RunDirectory) -> Existing:
    """The policy of an evaluation, as far as doubts ask for it."""
    plan, facts = directory.manifest()["specification"], _facts(directory)
    environments = environments_of(spec.testbed, spec.columns()[0], 1)
    environments.close()
    name = spec.name.removeprefix("evaluate ")
    folder = directory.policies / name
    home, origin = read_planned_home(plan), str(plan["home"].get("origin"))
    known = Provenance(home, spec.control_period, spec.environment, origin, {}, facts.overridden)
    policy: Any = SimpleNamespace(  # it does not act: nothing here plays an episode
        policy_id=name,
        content_hash=str(plan["policy"]),
        bounds=facts.bounds,
        statistics=facts.statistics or None,
    )
    files = {} if facts.file is None else {facts.file: folder / facts.file}
    space = environments.single_action_space
    return Existing(policy, known, files, facts.seed, space, facts.unscaled)


class Evaluation(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A file of cells to evaluate a policy in, `evaluate --spec`; see docs/reference/panel.md.

    Attributes:
        evaluate: tables of cells, as a panel has them.
        question: for the page.
        environment: constructor arguments common to all cells.
        episodes: paired starts.
        episode_seed: that of the first start.
        limit: whether a limit is extrapolated; None: where there is no truth and its steps fit.
    """

    evaluate: Annotated[list[dict[str, Any]], msgspec.Meta(min_length=1)]
    question: Name | None = None
    environment: dict[str, Any] = {}
    episodes: Count = 50
    episode_seed: Count = PanelSpec.episode_seed
    limit: bool | None = None


def plan(
    existing: Existing,
    env_id: str,
    integrators: Sequence[str] = (),
    dts: Sequence[float] = (),
    episodes: int | None = None,
    varied: Mapping[str, Any] = MappingProxyType({}),
    at: Sequence[str] = (),
    limit: bool | None = None,
    given: Evaluation | None = None,
    engines: Sequence[str] = (),
) -> PanelSpec:
    """The evaluation as a panel without training, all its cells checked.

    A baseline that cannot be made for the environment, such as a hand-made controller without
    gravity, is left out. The truth, where there is one, is always evaluated on.

    Args:
        existing: the policy.
        env_id: environment.
        integrators: names; by default all that the testbed offers but the truth.
        dts: steps, s; by default the testbed's.
        episodes: paired starts; by default 50, or those of `given`.
        varied: constructor arguments with the values that they take, every combination of them.
        at: `home` or `truth`: these are varied; by default every discretization is.
        limit: whether a limit is extrapolated; None: where there is no truth and its steps fit.
        given: cells, starts and limit of a file, in place of these; `episodes` goes before its.
        engines: names; by default the home's alone.

    Raises:
        TypeError, ValueError: for a cell that cannot be made.
    """
    for name in varied:
        if name in _BY_THEMSELVES:
            raise InputError(f"`{name}` is not varied but listed: {_BY_THEMSELVES[name]}")
    if at and not varied:
        raise InputError(
            f"nothing is varied at {' and '.join(at)}; say what, as `varied` or --vary"
        )
    environment = existing.provenance.environment
    testbed = find_testbed(env_id, environment)
    period, name = existing.provenance.control_period, existing.policy.policy_id
    own = () if existing.home is None else tuple(existing.home.shares)
    around = main_home(existing.home) or replace(testbed.home, control_period=period)
    form = given or Evaluation([])
    if given is not None:
        columns, asked, unmade = evaluation_cells(given.evaluate, around)
        limit = given.limit
        at = [place for table in given.evaluate for place in many(table.get("at", ()))]
    else:
        columns, asked, unmade = _every_combination(
            testbed, around, integrators, dts, varied, at, engines
        )
    if "home" in at and not own:
        raise InputError("the home is unknown, so nothing can be varied there; give --home")
    if "truth" in at and testbed.truth(period) is None:
        raise InputError(f"{env_id} has no truth, so nothing can be varied there; give `home`")
    homes = [existing.home] if existing.home else []
    steps, no_limit = choose_steps(testbed, homes, around, limit)
    spec = PanelSpec(
        name=f"evaluate {name}",
        env_id=env_id,
        control_period=period,
        train=(),
        grid=tuple(dict.fromkeys([*columns, *own])),
        seeds=(),
        environment=environment,
        limit=steps,
        ladder=False,
        episodes=episodes or form.episodes,
        episode_seed=form.episode_seed,
        question=form.question or f"Does {name} survive another integrator or timestep?",
        unmade=(*unmade, *no_limit),
    )
    whole = replace(
        spec,
        variations=(*standard_variations(spec.nominal), *asked),
        baselines=possible_baselines(spec.nominal, testbed.controller),
    )
    check_cells(whole, [existing.home])
    return whole


def _every_combination(
    testbed: Testbed,
    around: Discretization,
    integrators: Sequence[str],
    dts: Sequence[float],
    varied: Mapping[str, Any],
    at: Sequence[str],
    engines: Sequence[str],
) -> tuple[tuple[Discretization, ...], tuple[Variation, ...], tuple[str, ...]]:
    """As :func:`~.cells.evaluation_cells`, of lists that are multiplied."""
    engine = around.engine if integrators else testbed.home.engine
    periods = (
        [around.control_period] if at else many(varied.get("control_period", around.control_period))
    )
    columns, unmade = fitting(
        (
            Discretization(integrator, dt, one, another)
            for another, integrator in _methods(testbed, engines, integrators, engine)
            for one in periods
            for dt in dts or testbed.steps(around)
        ),
        dts or (),
    )
    rest = {name: x for name, x in varied.items() if at or name != "control_period"}
    if PACKAGES in rest:
        rest[PACKAGES] = [
            re.sub(r"\s*==\s*", "==", one).split() if isinstance(one, str) else one
            for one in many(rest[PACKAGES])
        ]
    places: Any = tuple(at) or (*columns, "home", "truth")
    return tuple(columns), tuple(vary(None, rest, places)) if rest else (), tuple(unmade)


def _methods(
    testbed: Testbed, engines: Sequence[str], integrators: Sequence[str], engine: str
) -> list[tuple[str, str]]:
    """Pairs of engine and integrator: those asked for, each engine with what it has of them.

    Raises:
        ValueError: for an integrator that none of the engines has, and an engine that has none.
    """
    if not engines:
        return [(engine, one) for one in integrators or testbed.integrators(engine)]
    found = [
        (one, name)
        for one in engines
        for name in testbed.integrators(one)
        if not integrators or name in integrators
    ]
    if lacking := [name for name in integrators if name not in {name for _, name in found}]:
        offered = dict.fromkeys(name for one in engines for name in testbed.integrators(one))
        kind = f"integrator of {', '.join(engines)}"
        raise InputError(unknown_name(kind, ", ".join(lacking), offered))
    for one in engines:
        if one not in {engine for engine, _ in found}:
            raise InputError(
                f"{one} has no integrator called {' or '.join(integrators)}; leave {one} out, or "
                f"name one of its own, too: {', '.join(testbed.integrators(one))}"
            )
    return found


_BY_THEMSELVES = {
    "integrator": "give --integrator NAME",
    "dt": "give --dt S",
    "engine": "give --engine NAME",
}
"""Arguments that an evaluation does not vary, and what to do."""

SHORT = 10.0
"""Expected work that is not worth starting worker processes for, s."""


def evaluate_existing(
    existing: Existing,
    spec: PanelSpec,
    out: Storage,
    command: str,
    *,
    workers: int | None = None,
    progress: bool = False,
    on_doubt: Callable[[str], None] = lambda doubt: None,
    cluster: Cluster | None = None,
) -> Panel:
    """Evaluate a policy and the baselines, and write the usual directory.

    Args:
        existing: the policy.
        spec: what :func:`~integ_gym.eval.panel.existing.plan` made.
        out: its directory, or where else it is kept; one that holds another policy's evaluation
            is refused.
        command: how to run this again, for the page.
        workers: processes; 1: this one; by default one per core where that is worth it.
        progress: show a bar.
        on_doubt: called at the end, with each sentence that casts doubt on the result.
        cluster: an engine that may be on other machines, in place of this one's processes.

    Returns:
        What ``panel.json`` holds; ``warnings`` lists the doubts.

    Raises:
        RunDirectoryError: for a directory that holds something else.
        SpawnError: where worker processes cannot be started, before anything is created.
        PanelError: if an evaluation fails; what was finished stays.
    """
    row, home, spec = existing.policy.policy_id, existing.home, as_there(spec, out)
    own = {"policy": existing.policy.content_hash, "home": existing.stated_home}
    content = {**spec.to_json(), **own}
    learned_by = installed_versions(TRAINERS["sb3"])
    directory = RunDirectory(out, content, {**learned_by, **spec.engine_versions()})
    subjects = [
        Subject(existing.policy, spec.cells_of(home), home, home_known=home is not None),
        *(Subject(baseline_of(spec, name), spec.cells_of(None)) for name in spec.baselines),
    ]
    if cluster is None or not cluster.remote:
        cluster = Cluster(_processes(workers, all_seconds(spec, subjects)))
    if cluster.workers:
        check_spawning(existing.policy, alone=True)
    cells = {cell.name: cell for subject in subjects for cell in subject.cells}
    policies = [subject.policy for subject in subjects]
    make_interpreters(spec, list(cells.values()), policies, progress)
    with directory.opened():
        for name, source in existing.files.items():
            replace_file(directory.policies / row / name, source.read_bytes())
        before = directory.markers("")
        evaluate_all(spec, directory, subjects, "evaluate", cluster, progress)
        if progress and directory.markers("") == before:
            print("Complete: nothing to evaluate.", file=sys.stderr)
        with phases("evaluate", progress) as begin:
            begin(CHECKING)
            check_records(directory)
            begin(JUDGING)
            directory.note(**{GIVEN: facts_of(existing)})
            directory.record_look(Seen(1, spec.episodes, 0))
            called = Call(command, max(1, cluster.workers), display_path(str(directory.storage)))
            made = build_given_panel(spec, directory, called)
            panel = write_outputs(directory, made, called, begin)
        directory.finish_work()
    for doubt in panel.warnings:
        on_doubt(doubt)
    return panel


def _processes(workers: int | None, seconds: float) -> int:
    """Worker processes; 0: this one works."""
    if workers is not None and workers < 1:
        raise InputError(f"`workers` must be 1 or above, got {workers}")
    few = seconds < SHORT if workers is None else workers == 1
    return 0 if few else workers or cores()


def _read_cells(path: Path) -> Evaluation:
    """An evaluation's specification.

    Raises:
        SpecError: if the file cannot be read, or has another form.
    """
    data = read_toml(path)
    try:
        return convert("", data, Evaluation)
    except SpecError as error:
        raise SpecError(f"{path}: {error}") from None


def tell_doubt(doubt: str) -> None:
    """Say a sentence that casts doubt on a result on stderr."""
    print_wrapped(f"warning: {doubt}", sys.stderr)


def evaluate(
    policy: Any,
    env_id: str,
    out: str | os.PathLike[str],
    *,
    home: Stated = None,
    integrators: Sequence[str] = (),
    dts: Sequence[float] = (),
    episodes: int | None = None,
    varied: Mapping[str, Any] | None = None,
    at: Sequence[str] = (),
    limit: bool | None = None,
    spec: str | os.PathLike[str] | None = None,
    engines: Sequence[str] = (),
    environment: Mapping[str, Any] | None = None,
    obs_stats: str | os.PathLike[str] | None = None,
    own_code: bool = False,
    workers: int | None = None,
    progress: bool = True,
    on_home: Callable[[str], None] = lambda line: None,
    on_cells: Callable[[Sequence[str]], None] = lambda names: None,
    on_doubt: Callable[[str], None] = tell_doubt,
    command: str = "integ_gym.evaluate",
    executor: str = "local",
    address: str | None = None,
    resources: Resources | None = None,
) -> Panel:
    """Judge a policy that exists already over many discretizations: a panel without training.

    Args:
        policy: a policy's file, and beside it the side-car if there is one; a function from one
            observation to one action; anything with ``predict``, such as a model of
            stable-baselines3; ``"module:function"``; or ``"hf://USER/REPO[/FILE]"`` of the Hugging
            Face Hub.
        env_id: one of integ-gym's environments, or a MuJoCo task of Gymnasium's.
        out: directory, or a place in an object store; one that holds another policy's evaluation
            is refused.
        home: what it was trained on: ``"integrator=…,dt=…,control_period=…"``, the same as a
            mapping or a `Discretization`, or ``"stock"`` for the environment as its library
            makes it. By default what the side-car says; without one it is unknown, and null in
            evidence.
        integrators: to judge on; by default all.
        dts: integration steps, s; by default the coarsest, half and a quarter of it.
        episodes: paired starts; by default 50, or those of `spec`.
        varied: constructor arguments with a value or a list of them, such as
            ``{"control_period": [0.02, 0.1], "action_latency": [0.0, 0.02]}``: every combination
            is evaluated. ``packages`` takes versions such as ``["mujoco==3.1.0",
            "mujoco==3.2.7"]``, each for cells of its own, in an interpreter that uv makes; of
            several at once a list or ``"mujoco==3.1.0 numpy==2.2.0"``.
        at: where: ``"home"``, ``"truth"``, or both; by default in every discretization.
        limit: whether a limit is extrapolated from the best integrator's finer steps; by default
            where there is no truth and these steps fit.
        spec: a TOML file of cells, starts and limit, in place of these; docs/reference/panel.md has
            the form.
        engines: to judge on, each by those of the integrators that it has; by default the home's.
        environment: constructor arguments, without the discretization.
        obs_stats: VecNormalize's statistics, as its ``vecnormalize.pkl`` or as JSON.
        own_code: whether classes that the side-car names as ``"module:Class"`` may be loaded.
        workers: processes; 1: this one; by default one per core where that is worth it.
        progress: show a bar on stderr.
        on_home: called with what is taken as home and why, before anything is run.
        on_cells: gets the names of the policy's cells, likewise; may refuse them.
        on_doubt: called with each sentence that casts doubt on the result; by default it is printed
            on stderr.
        command: how to run this again, for the page.
        executor: what runs the processes; see :func:`run_panel`.
        address: of a running cluster.
        resources: of each worker of an engine.

    Returns:
        What ``panel.json`` holds; ``warnings`` lists the doubts.

    Raises:
        PolicyFileError, TypeError, ValueError: for a policy that cannot be read or does not fit, a
            home that cannot be, or a cell that cannot be made.
        RunDirectoryError: for a directory that holds something else.
        SpawnError: where worker processes cannot be started, before anything is created.
        PanelError: if an evaluation fails; what was finished stays.
        ModuleNotFoundError: if an extra is missing, with the command that installs it.
    """
    require("report", "evidence")
    cells = None if spec is None else _read_cells(Path(spec))
    if cells is not None and (engines or integrators or dts or varied or at or limit is not None):
        raise InputError(f"{spec} lists the cells; give no other options for cells, or omit it")
    given = {**({} if cells is None else cells.environment), **(environment or {})}
    policy = fetch_file(policy) if is_on_hub(policy) else policy
    obs_stats = fetch_file(str(obs_stats)) if is_on_hub(obs_stats) else obs_stats
    if isinstance(policy, os.PathLike) and not Path(policy).exists():
        policy = os.fspath(policy)
    if is_reference(policy) or not isinstance(policy, str | os.PathLike):
        if obs_stats is not None:
            raise InputError(
                "statistics of observations are given for a policy's file; a model carries its own "
                "VecNormalize, and a function normalizes for itself"
            )
        if own_code:
            raise InputError(
                "own_code is for the side-car of a policy's file, and this policy is none; omit it"
            )
        existing = given_policy(policy, env_id, given, home)
    else:
        if not isinstance(obs_stats, str | os.PathLike | None):
            raise InputTypeError(
                "obs_stats must be a file, which the run keeps; save its numbers as JSON, or with "
                "integ_gym.write_sidecar(..., obs_stats=...)"
            )
        statistics = None if obs_stats is None else Path(obs_stats)
        existing = read_existing(Path(policy), env_id, given, statistics, own_code, home)
    whole = plan(
        existing, env_id, integrators, dts, episodes, varied or {}, at, limit, cells, engines
    )
    on_cells([cell.name for cell in whole.cells_of(existing.home)])
    on_home(str(existing.provenance))
    asked = resources_for(resources, workers, None)
    with open_cluster(executor, address, asked) as cluster, open_storage(out) as place:
        return evaluate_existing(
            existing,
            whole,
            place,
            command,
            workers=workers,
            progress=progress,
            on_doubt=on_doubt,
            cluster=cluster,
        )
