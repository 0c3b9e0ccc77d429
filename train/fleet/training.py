"""The fleet trainer: PPO of many policies at once, compiled, on all cores or GPUs.

    configs = [PPOConfig.of("IntegPendulum-v0", seed=seed) for seed in range(10)]
    train_fleet(configs, [Path("runs") / f"seed{seed}" for seed in range(10)])

The algorithm, its hyperparameters and the files it writes are those of `integ_gym.train.ppo`; the
random numbers are not, so a seed gives another policy of the same distribution. A policy depends on
its own configuration alone, up to rounding, whatever else is trained beside it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from integ_gym.envs import functional
from integ_gym.envs.functional import FunctionalEnv
from integ_gym.envs.ops.jax_ops import jax, jnp
from integ_gym.envs.settings import Mixture, Setup
from integ_gym.envs.transition import quiet_status
from integ_gym.evidence.episodes import EpisodeHeads, EpisodeLog, Layout
from integ_gym.evidence.recorder import now
from integ_gym.evidence.store import EvidenceStore
from integ_gym.evidence.table import build_unhashed_table
from integ_gym.support.errors import InputError
from integ_gym.support.executors import Cluster
from integ_gym.support.optional import installed_versions, require
from integ_gym.support.processes import report_work

from ..config import TrainingEvidence
from ..policy_files.card import LAST_EPISODES, episode_summary, make_card
from ..policy_files.sidecar import TrainedPolicy, actor_of, write_actor
from ..ppo import PPOConfig, model_arguments
from ..runs import (
    OnTrained,
    Run,
    check_runs,
    no_op,
    resolve_executor,
    train_in_processes,
    training_bar,
)
from . import learning
from .planning import ROWS_AT_ONCE, Chunk, Kind, kind_of, plan
from .program import FleetProgram
from .worker import Device, fleet_workers, prepare_worker, workers_of

Array = NDArray[Any]


class _Found(NamedTuple):
    """A whole episode: where in the rollout it ended, its rows, and which setup it ran on."""

    step: int
    lane: int
    rows: int
    setup: int


class EpisodeAssembler:
    """Puts the steps of one policy's rollouts together to whole episodes.

    Args:
        evidence: where they go.
        env_id: environment.
        setups: what it was made of; several in a mixture.
        layout: what the entries of a row are.
        seed: of the training run.
        lanes: environments that advance together.
    """

    def __init__(
        self,
        evidence: TrainingEvidence,
        env_id: str,
        setups: Sequence[Setup],
        layout: Layout,
        seed: int,
        lanes: int,
    ) -> None:
        packages = {**evidence.context.packages, **installed_versions(["jax"])}
        self._evidence = evidence
        self._context = replace(evidence.context, float_width=32, packages=packages)
        self._env_id = env_id
        self._setups = [(setup, 0) for setup in setups]
        self._layout = layout
        self._log = EpisodeLog(layout, [self._context], ROWS_AT_ONCE)
        self._seed = seed
        self._open = [np.zeros((len(layout), 0)) for _ in range(lanes)]
        self._opened = np.full(lanes, now())
        self._draws = np.zeros(lanes, dtype=np.int64)
        self._quiet = np.array([quiet_status(setup) for setup in setups])
        self._next_index = evidence.context.first_episode
        self._clock = now()

    def add(
        self, rows: Array, first_rows: Array, begun: Array, ended: Array, member: Array
    ) -> None:
        """Take in one rollout.

        Args:
            rows: after each step, shape (entries, steps, lanes).
            first_rows: before each step, entries as :meth:`Layout.start` gives them, else the same
                shape.
            begun: whether an episode begins with a step, shape (steps, lanes).
            ended: whether one ends with it.
            member: of ``setups``, that the episode runs on.
        """
        clock = now()
        steps, lanes = begun.shape
        taken = [np.zeros((len(self._layout), 0))]
        found: list[_Found] = []
        for lane in range(lanes):
            joined, last_of = self._join_rows(lane, rows, first_rows, begun, member[:, lane])
            stops = np.flatnonzero(ended[:, lane])
            ends = last_of[stops] + 1
            whole = int(ends[-1]) if len(ends) else 0
            taken.append(joined[:, :whole])
            self._open[lane] = joined[:, whole:]
            counts = np.diff(ends, prepend=0)
            found += [
                _Found(int(step), lane, int(count), int(member[step, lane]))
                for step, count in zip(stops, counts, strict=True)
            ]
        self._log_episodes(np.concatenate(taken, axis=1), found, self._clock, clock, steps)
        self._clock = clock

    def commit(self) -> Path | None:
        """Write the finished episodes; None if there are none."""
        if not len(self._log):
            return None
        table = build_unhashed_table(self._log, self._env_id, self._setups)
        return EvidenceStore(self._evidence.store).commit_unhashed(self._evidence.batch, table)

    def _join_rows(
        self, lane: int, rows: Array, first_rows: Array, begun: Array, member: Array
    ) -> tuple[Array, Array]:
        """A lane's rows, with those left over in front and a row for every reset.

        Returns:
            The rows, and the place of each step's row among them.
        """
        left = self._open[lane]
        starts = np.flatnonzero(begun[:, lane])
        places = left.shape[1] + np.arange(len(begun)) + np.cumsum(begun[:, lane])
        joined = np.zeros((len(self._layout), left.shape[1] + len(begun) + len(starts)))
        joined[:, : left.shape[1]] = left
        joined[:, places] = rows[:, :, lane]
        joined[:, places[starts] - 1] = self._layout.start_rows(
            first_rows[:, starts, lane], self._quiet[member[starts]]
        )
        return joined, places

    def _log_episodes(
        self, rows: Array, found: list[_Found], before: int, after: int, steps: int
    ) -> None:
        """Hand whole episodes to the log, numbered in the order in which they ended.

        Args:
            rows: theirs, lane by lane.
            found: the episodes, lane by lane.
            before: time at the start of the rollout, µs.
            after: time at its end, µs.
            steps: decisions of a lane in it.
        """
        order = sorted(range(len(found)), key=lambda i: (found[i].step, found[i].lane))
        index = {place: self._next_index + rank for rank, place in enumerate(order)}
        self._next_index += len(found)
        heads = []
        for place, (step, lane, _, setup) in enumerate(found):
            ended = before + (after - before) * (step + 1) // steps
            key = f"fleet-{self._seed}-{lane}/{self._draws[lane]}"
            head = index[place], None, key, int(self._opened[lane]), ended, setup, 0
            heads.append(EpisodeHeads.of_one(*head))
            self._opened[lane] = ended
            self._draws[lane] += 1
        if heads:
            counts = np.array([episode.rows for episode in found])
            self._log.add(rows, counts, EpisodeHeads.joined(heads))


@dataclass(frozen=True)
class Outcome:
    """What training one policy of a chunk gave.

    Attributes:
        weights: by stable-baselines3's names.
        seconds: wall time of the chunk, divided by its policies.
        last_episodes: the last episodes of training.
    """

    weights: dict[str, NDArray[np.float32]]
    seconds: float
    last_episodes: dict[str, Any]


def train_fleet(
    configs: Sequence[PPOConfig],
    out_dirs: Sequence[str | Path],
    *,
    evidence: Sequence[TrainingEvidence] | None = None,
    progress: bool = True,
    workers: int | None = None,
    force: bool = False,
    on_trained: OnTrained = no_op,
    memory_gib: float | None = None,
    cache_dir: str | Path | None = None,
    executor: str | Cluster = "local",
    address: str | None = None,
    together: Sequence[Sequence[int]] | None = None,
) -> list[TrainedPolicy]:
    """Train policies and write each as `integ_gym.train.runs.train_ppo` does.

    `policy.zip` is written where stable-baselines3 is installed.

    Args:
        configs: the runs; they may differ in everything.
        out_dirs: a folder for each policy.
        evidence: where the training episodes of each are recorded; None: nowhere.
        progress: show a bar on stderr.
        workers: processes; by default one per GPU, or one per core. There is never more than one
            per GPU. 0: none but this one, which is set up as they are: for a program that has not
            used JAX before, and trains no more at once than one of them would.
        force: replace policies that are already there.
        on_trained: called with the index in `configs` of every policy once it and its evidence are
            written.
        memory_gib: see :func:`integ_gym.train.fleet.planning.plan`.
        cache_dir: compiled programs are kept there; by default in the user's cache folder.
        executor: what runs the processes: see :func:`integ_gym.support.executors.open_cluster`.
        address: of a running cluster.
        together: places in `configs` of those that are trained together; by default as
            :func:`integ_gym.train.fleet.planning.plan` divides them.

    Raises:
        OSError: if a folder cannot be used, or holds a policy and `force` is not given.
        TypeError, ValueError: for arguments that are not possible, before anything is trained.
        ModuleNotFoundError: if an extra is missing, with the command that installs it.
        TrainingError: if a worker fails or is killed; finished policies stay.
    """
    require("fleet")
    runs = check_runs(configs, out_dirs, evidence, force)
    here = workers == 0
    where = Cluster(0) if here else executor
    with resolve_executor(where, address, workers, memory_gib) as cluster:
        processes = fleet_workers(1) if here else workers_of(cluster)
        prepare = preparation(processes.device, cache_dir)
        if here:
            for config in configs:
                kind_of(config)  # refuses, before anything of this process is changed
            prepare(0)
        chunks = (
            plan(configs, processes, memory_gib)
            if together is None
            else [Chunk(kind_of(configs[places[0]]), tuple(places)) for places in together]
        )
        for _, folder, _ in runs:
            folder.mkdir(parents=True, exist_ok=True)
        if not (cluster.remote or here):
            cluster = replace(cluster, workers=processes.count)
            if learning.can_save():
                learning.import_ahead()
        return train_in_processes(
            _run_and_write if cluster.remote else _run_here if here else _run,
            runs,
            [chunk.places for chunk in chunks],
            cluster,
            training_bar(sum(chunk.decisions for chunk in chunks), len(configs), progress),
            on_trained,
            write=lambda place, done: write_outcome(configs[place], done, runs[place][1]),
            prepare=prepare,
            starting="compiling",
        )


def preparation(device: Device, cache_dir: str | Path | None = None) -> Callable[[int], None]:
    """What sets up JAX in a worker process; see :func:`prepare_worker`."""
    return partial(prepare_worker, None if cache_dir is None else str(cache_dir), device)


def train_chunk(
    configs: Sequence[PPOConfig],
    evidence: Sequence[TrainingEvidence] | None = None,
    on_steps: Callable[[int], None] | None = None,
) -> list[Outcome]:
    """Train runs of one kind together, in this process.

    Args:
        configs: the runs.
        evidence: where the training episodes of each are recorded.
        on_steps: called with the decisions of all policies after each rollout.

    Raises:
        ValueError: if they are of different kinds.
    """
    with jax.enable_x64(False):
        trainer = _Trainer(_common_kind(configs), configs, evidence)
        return trainer.outcomes(trainer.train(on_steps))


def train_in_stages(stages: Sequence[Sequence[PPOConfig]]) -> list[Outcome]:
    """Train policies in one environment after another, in this process.

    Each stage takes an equal share of the rollouts of a whole run. Networks, optimizer and learning
    rate go on from where the stage before ended; episodes begin anew.

    Args:
        stages: the runs of each stage, in the same order; they differ in environment arguments
            alone.

    Returns:
        What the last stage gave, with its time alone.

    Raises:
        ValueError: if there is no stage, if there are more than rollouts, or if a stage's runs are
            of different kinds.
    """
    if not stages:
        raise InputError("there is no stage to train in")
    learner: learning.Learner | None = None
    with jax.enable_x64(False):
        trainers = [_Trainer(_common_kind(configs), configs) for configs in stages]
        rollouts = trainers[0].rollouts
        if len(stages) > rollouts:
            raise InputError(f"{len(stages)} stages of {rollouts} rollouts: some would have none")
        ends = [round(place * rollouts / len(stages)) for place in range(len(stages) + 1)]
        for trainer, begun, ended in zip(trainers, ends, ends[1:], strict=False):
            learner = trainer.train(None, ended - begun, learner)
        assert learner is not None
        return trainers[-1].outcomes(learner)


def _common_kind(configs: Sequence[PPOConfig]) -> Kind:
    kinds = {kind_of(config) for config in configs}
    if len(kinds) != 1:
        raise InputError(f"the runs of a chunk must be of one kind, got {len(kinds)}: {kinds}")
    return kinds.pop()


@dataclass
class _Returns:
    """Returns and successes of the last episodes of one policy.

    Attributes:
        so_far: return of the episode under way in each lane.
        returns: of finished episodes, oldest first.
        successes: of the same.
    """

    so_far: Array
    returns: list[float] = field(default_factory=list)
    successes: list[float] = field(default_factory=list)

    def add(self, rewards: Array, ended: Array, success: Array) -> None:
        """Take in a rollout, arrays of shape (steps, lanes)."""
        totals = np.cumsum(rewards, axis=0, dtype=np.float64) + self.so_far
        before = np.zeros_like(self.so_far)
        for step in np.flatnonzero(ended.any(axis=1)):
            lanes = np.flatnonzero(ended[step])
            self.returns += (totals[step, lanes] - before[lanes]).tolist()
            self.successes += success[step, lanes].astype(float).tolist()
            before[lanes] = totals[step, lanes]
        self.so_far = totals[-1] - before
        del self.returns[:-LAST_EPISODES], self.successes[:-LAST_EPISODES]


class _Trainer:
    """One chunk on its way."""

    def __init__(
        self,
        kind: Kind,
        configs: Sequence[PPOConfig],
        evidence: Sequence[TrainingEvidence] | None = None,
    ) -> None:
        self._kind = kind
        self._seconds = 0.0
        self._configs = configs
        envs = [functional.make(c.env_id, **c.env_arguments) for c in configs]
        self._mixtures = [Mixture(env.setups, env.shares) for env in envs]
        self._params = envs[0].columns([env.default_params for env in envs])
        lanes = kind.algorithm.n_envs
        self._returns = [_Returns(np.zeros(lanes)) for _ in configs]
        layout = None if evidence is None else _layout(envs[0], lanes)
        self._program = _program(kind, envs[0], layout)
        self._assemblers = [
            EpisodeAssembler(recorder, config.env_id, env.setups, layout, config.seed, lanes)
            for recorder, config, env in zip(evidence or (), configs, envs, strict=False)
            if layout is not None
        ]

    @property
    def rollouts(self) -> int:
        """In a whole run."""
        return self._kind.rollouts

    def train(
        self,
        on_steps: Callable[[int], None] | None,
        rollouts: int | None = None,
        learner: learning.Learner | None = None,
    ) -> learning.Learner:
        """Some rollouts, by default all; the host takes one in while the next is computed.

        Args:
            on_steps: called with the decisions of all policies after each rollout.
            rollouts: how many.
            learner: what goes on learning, in episodes that begin anew; None: a new one.
        """
        started = time.perf_counter()
        knobs = self._knobs()
        learner = self._begin(learner)
        decisions = len(self._configs) * self._kind.algorithm.rollout
        trail: learning.Trail | None = None
        for _ in range(self.rollouts if rollouts is None else rollouts):
            learner, next_trail = self._program.iterate(learner, knobs, self._params)
            if trail is not None:
                self._take(trail)
            trail = next_trail
            if on_steps is not None:
                on_steps(decisions)
        if trail is not None:
            self._take(trail)
        for assembler in self._assemblers:
            assembler.commit()
        self._seconds = (time.perf_counter() - started) / len(self._configs)
        return learner

    def outcomes(self, learner: learning.Learner) -> list[Outcome]:
        """What training gave, of every policy."""
        stack = jax.tree.map(np.asarray, learner.stack)
        return [
            Outcome(
                learning.state_dict(stack, place),
                self._seconds,
                episode_summary(of_policy.returns, of_policy.successes),
            )
            for place, of_policy in enumerate(self._returns)
        ]

    def _begin(self, before: learning.Learner | None) -> learning.Learner:
        begun = self._new()
        if before is None:
            return begun
        # A learner of its own: what a program is given it may use up.
        stack, adam, iteration = jax.tree.map(
            jnp.copy, (before.stack, before.adam, before.iteration)
        )
        return begun._replace(stack=stack, adam=adam, iteration=iteration)

    def _new(self) -> learning.Learner:
        configs = self._configs
        setup = self._mixtures[0].setups[0]
        outputs = setup.task.discrete or setup.action_size
        noise = None if setup.task.discrete else [config.log_std_init for config in configs]
        seeds = [config.seed for config in configs]
        stack = learning.initial_stack(seeds, self._kind.sizes, outputs, noise)
        lane_seeds = np.array([config.first_lane_seed for config in configs], dtype=np.uint32)
        return self._program.begin(stack, jax.vmap(jax.random.key)(lane_seeds), self._params)

    def _knobs(self) -> learning.Knobs:
        rows = []
        for config, mixture in zip(self._configs, self._mixtures, strict=True):
            gammas = [config.discount(period) for period in mixture.periods]
            values = {**vars(config), "gamma": gammas if mixture.several_periods else gammas[0]}
            if config.learning_rate_end is None:
                values["learning_rate_end"] = config.learning_rate
            values["target_kl"] = config.target_kl or 0.0
            rows.append([values[name] for name in learning.Knobs._fields])
        return learning.Knobs(*(np.array(column, np.float32) for column in zip(*rows, strict=True)))

    def _take(self, trail: learning.Trail) -> None:
        """Book a rollout's episodes."""
        rewards, ended, success, begun, member = (np.asarray(x) for x in trail[:5])
        for place, returns in enumerate(self._returns):
            returns.add(rewards[:, place], ended[:, place], success[:, place])
        if self._assemblers:
            rows, first_rows = np.asarray(trail.rows), np.asarray(trail.first_rows)
            for place, assembler in enumerate(self._assemblers):
                of_steps = (values[:, place] for values in (begun, ended, member))
                assembler.add(rows[:, :, place], first_rows[:, :, place], *of_steps)


def _run(
    runs: Sequence[Run[PPOConfig]], on_steps: Callable[[int], None] = report_work
) -> list[Outcome]:
    """One chunk, in a worker process."""
    evidence = [recorder for _, _, recorder in runs if recorder is not None]
    return train_chunk([config for config, _, _ in runs], evidence or None, on_steps)


def _run_here(runs: Sequence[Run[PPOConfig]]) -> list[Outcome]:
    """One chunk, in this process: it imports while the compiled program runs, and not before."""

    def report(steps: int) -> None:
        if learning.can_save():
            learning.import_ahead()
        report_work(steps)

    return _run(runs, report)


def _run_and_write(runs: Sequence[Run[PPOConfig]]) -> list[TrainedPolicy]:
    """One chunk, in a process of another machine, which writes what it trained."""
    outcomes = zip(runs, _run(runs), strict=True)
    return [write_outcome(config, outcome, folder) for (config, folder, _), outcome in outcomes]


def write_outcome(config: PPOConfig, outcome: Outcome, folder: Path) -> TrainedPolicy:
    """Write a trained policy into a folder that exists.

    Raises:
        ValueError: if its weights are not finite.
    """
    env = functional.make(config.env_id, **config.env_arguments)
    space, hidden = env.action_space, len(config.net_arch)
    actor = actor_of(outcome.weights, hidden, config.activation, space)
    mixture = Mixture(env.setups, env.shares)
    card = make_card(config, mixture, "fleet", outcome.seconds, outcome.last_episodes)
    zip_bytes = _zip(config, env, mixture, outcome) if learning.can_save() else None
    return write_actor(folder, actor, card, space, zip_bytes)


def _zip(config: PPOConfig, env: FunctionalEnv, mixture: Mixture, outcome: Outcome) -> bytes:
    """The policy as stable-baselines3 saves it."""
    learning.import_ahead().join()  # two threads that import the same find it half done
    return learning.zip_of_weights(
        model_arguments(config, mixture.mean_period),
        config.n_envs,
        (env.observation_space, env.action_space),
        outcome.weights,
        config.rounded_steps,
    )


_programs: dict[tuple[Hashable, learning.Algorithm, bool], FleetProgram] = {}
"""Compiled programs of this process."""


def _program(kind: Kind, env: FunctionalEnv, layout: Layout | None) -> FleetProgram:
    """The program of a kind; kinds that differ in counts alone share one."""
    key = (kind.structure, kind.algorithm, layout is not None)
    if key not in _programs:
        on_cpu = jax.default_backend() == "cpu"
        _programs[key] = FleetProgram(env, kind.algorithm, layout, in_turn=on_cpu)
    return _programs[key]


def _layout(env: FunctionalEnv, n_envs: int) -> Layout:
    """What the entries of an evidence row are."""
    info = jax.eval_shape(
        lambda key: env.state_info(env.initial(key, lanes=(n_envs,))), jax.random.key(0)
    )
    return Layout(env.setup.plant, env.setup.task, info)
