"""An engine that counts what an integrator asks of the plant."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, make_dataclass, replace
from functools import cache, partial
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.engines.stepping import NativeEngine
from integ_gym.envs.environment import IntegEnv
from integ_gym.envs.ops.ops import Component, Components, Ops, join_state
from integ_gym.envs.plants.interface import state_names, state_units
from integ_gym.envs.plants.system import PlantSystem
from integ_gym.envs.registries import PLANTS
from integ_gym.envs.tasks.interface import BoxTask, Limits, to_public_order
from integ_gym.envs.vector import IntegVectorEnv
from integ_gym.evidence.labels import EpisodeContext
from integ_gym.evidence.recorder import RecordEvidence
from integ_gym.evidence.store import EvidenceStore
from integ_gym.evidence.vector_recorder import RecordVectorEvidence
from integ_gym.support.parameters import parameter, positive
from integ_gym.train.policy import Policy

from .subject import Array, Subject, control_unit


class CountingSystem(PlantSystem):
    """A system that counts how often it is asked for accelerations or a Jacobian."""

    evaluations = 0

    def rates(self, *arguments: Any) -> Any:
        self.evaluations += 1
        return super().rates(*arguments)

    def slopes(self, *arguments: Any) -> Any:
        given = super().slopes(*arguments)
        self.evaluations += given is not None
        return given


class CountingEngine(NativeEngine):
    """The native engine, called step by step: a traced step would be counted once."""

    batched: ClassVar[bool] = False


def count_evaluations(env: IntegEnv) -> CountingSystem:
    """Put a counting engine into an environment; the motion stays the same bit by bit."""
    setup = env.setup
    stopped = setup.system.engine_stops is not None
    system = CountingSystem(setup.plant, setup.system.max_speed, stopped)
    engine = CountingEngine(system, setup.settings.integrator, setup.settings.dt)
    env.setup = replace(setup, engine=engine)
    return system


SEED = 0
"""Of the first lane's start."""


@dataclass(frozen=True)
class Rollout:
    """Episodes side by side; NaN after the end of an episode.

    Attributes:
        time: control instants, s, shape (instants,).
        state: true states in state order, SI units, shape (instants, lanes, n).
        info: numbers of ``info`` at each instant, shape (instants, lanes), by name.
        success: whether each episode met its task, shape (lanes,).
        evaluations: of accelerations and Jacobians on the way; None where they were not counted.
    """

    time: Array
    state: Array
    info: Mapping[str, Array]
    success: Array
    evaluations: int | None = None

    def so_far(self, name: str) -> Array:
        """What was booked under a name up to each instant, shape (instants, lanes)."""
        return np.asarray(np.cumsum(self.info[name], axis=0))

    def residual(self) -> Array:
        """Σ |energy residual| over the control periods, J, shape (lanes,); NaN where diverged."""
        return np.asarray(np.abs(self.info["energy_residual"]).sum(axis=0))

    def diverged(self) -> Array:
        """Whether an episode ended before its time, shape (lanes,)."""
        return np.asarray(~np.isfinite(self.info["energy"][-1]))


def follow(
    recorder: RecordEvidence | RecordVectorEvidence, policy: Policy, starts: Array | None
) -> Rollout:
    """One episode of a single environment, or one in every lane.

    Args:
        recorder: of the environment.
        policy: what acts.
        starts: shape (n,) or (lanes, n); None: the task's own.
    """
    inner: Any = recorder.env.unwrapped
    timing, alone = inner.setup.timing, isinstance(recorder, RecordEvidence)
    task = inner.setup.task
    options = None if starts is None else {"state": to_public_order(task, starts)}
    observation, info = recorder.reset(seed=SEED, options=options)
    names = [n for n, x in info.items() if n[0] != "_" and np.asarray(x).dtype.kind in "biuf"]
    running = np.ones(np.shape(inner.state_components[0]), dtype=bool)
    success = ~running
    states, rows, lived = [], [], []
    for instant in range(timing.horizon + 1):
        states.append(np.array(inner.state_components))
        rows.append(np.array([info[name] for name in names], dtype=np.float64))
        lived.append(running)
        if instant == timing.horizon:
            break
        action = policy.act(np.asarray(observation)[None])[0] if alone else policy.act(observation)
        observation, _, terminated, truncated, info = recorder.step(action)
        success = success | (running & info["success"])
        running = running & (info["solver_status"] != "diverged")
        if instant + 1 < timing.horizon:
            running = running & ~np.logical_or(terminated, truncated)
        if not running.any():
            break
    booked = _table(rows, lived, timing.horizon + 1)
    return Rollout(
        time=np.arange(timing.horizon + 1) * timing.control_period,
        state=np.swapaxes(_table(states, lived, timing.horizon + 1), 1, 2),
        info={name: booked[:, i] for i, name in enumerate(names)},
        success=np.atleast_1d(success),
    )


def _table(rows: list[Array], lived: list[Array], length: int) -> Array:
    """Rows in an array of shape (length, numbers, lanes), NaN where there is none."""
    table = np.full((length, len(rows[0]), lived[0].size), np.nan)
    values = np.reshape(rows, (len(rows), *table.shape[1:]))
    table[: len(rows)] = np.where(np.reshape(lived, (len(rows), 1, -1)), values, np.nan)
    return table


_MOST_DECISIONS = 64
"""A motion of more steps at a constant control is recorded at every so many of them."""


class Commands:
    """A policy that plays a list of commands, the same in every lane.

    Args:
        name: of the policy.
        values: of every control, in its unit, shape (decisions, controls).
    """

    def __init__(self, name: str, values: Array) -> None:
        self.policy_id = name
        self.values = np.asarray(values, dtype=np.float64)
        self.content_hash = hashlib.sha256(self.values.tobytes()).hexdigest()
        self._next = 0

    def act(self, observations: Array) -> Array:
        """The next command for every lane, shape (lanes, controls)."""
        value = self.values[self._next % len(self.values)]
        self._next += 1
        return np.tile(value, (len(observations), 1))


class Bench:
    """Runs episodes and keeps their evidence.

    Args:
        store: where the records go.
        run_id: the run that they belong to.
    """

    def __init__(self, store: EvidenceStore, run_id: str) -> None:
        self.store = store
        self.run_id = run_id
        self._tables: dict[str, list[Any]] = {}

    def run_open_loop(
        self,
        cell: str,
        subject: Subject,
        integrator: str,
        dt: float,
        commands: tuple[str, Array],
        starts: Array,
        **arguments: Any,
    ) -> Rollout:
        """Follow the bare plant from given starts under given commands.

        Args:
            cell: what the episodes are for, unique within the diagnosis.
            subject: the plant.
            integrator: a registered name or ``"module:Class"``.
            dt: integration step, s.
            commands: their name, and one for each decision, shape (decisions, controls) or one of
                all controls, shape (decisions, 1).
            starts: one per lane, state order, shape (lanes, n); of a single one evaluations of the
                plant are counted.
            arguments: further constructor arguments; ``duration`` in s among them.
        """
        environment = open_loop_environment(subject.name)
        name, values = commands
        shape = len(values), len(subject.plant.controls)
        policy = Commands(name, np.broadcast_to(values, shape))
        arguments = {
            "control_period": subject.control_period, **arguments,
            "integrator": integrator, "dt": dt,
        }  # fmt: skip
        if len(starts) > 1:
            return self._lanes(cell, environment(len(starts), **arguments), policy, starts)
        env = environment.env_class(**arguments)
        system = count_evaluations(env)
        rollout = self._record_episodes(
            RecordEvidence, environment.__name__, cell, env, policy, starts[0]
        )
        return replace(rollout, evaluations=system.evaluations)

    def task(
        self,
        cell: str,
        env_id: str,
        policy: Policy,
        lanes: int,
        starts: Array | None = None,
        **arguments: Any,
    ) -> Rollout:
        """Play a registered environment.

        Args:
            cell: what the episodes are for, unique within the diagnosis.
            env_id: the environment.
            policy: what acts.
            lanes: episodes; lane k starts from seed ``SEED + k``.
            starts: one per lane, shape (lanes, n); None: from its own start distribution.
            arguments: constructor arguments.
        """
        return self._lanes(cell, gym.make_vec(env_id, num_envs=lanes, **arguments), policy, starts)

    def advance(self, cell: str, subject: Subject) -> numerics.Advance:
        """What :func:`integ_gym.envs.numerics.advance` does to the undamped plant, recorded.

        Args:
            cell: what the motions are for, unique within the diagnosis.
            subject: the plant.
        """
        count = iter(range(10**9))

        def advance(
            integrator: str, plant: Any, state: Any, dt: float, steps: int, control: float
        ) -> Array:
            decisions = steps if steps <= _MOST_DECISIONS else math.gcd(steps, _MOST_DECISIONS)
            period = steps // decisions * dt
            rollout = self.run_open_loop(
                f"{cell}/{next(count)}", subject, integrator, dt,
                ("constant", np.array([[control]])), np.asarray(state)[None],
                control_period=period, duration=decisions * period, **subject.undamped,
            )  # fmt: skip
            return np.asarray(rollout.state[-1, 0])

        return advance

    def commit(self, section: str) -> None:
        """Write the records made since the last call, one batch per environment."""
        for name, tables in self._tables.items():
            self.store.commit_all(f"{section}-{name}", tables)
        self._tables.clear()

    def _lanes(self, cell: str, environments: Any, policy: Policy, starts: Array | None) -> Rollout:
        name = environments.spec.id if environments.spec else type(environments).__name__
        record = partial(RecordVectorEvidence, episodes=range(environments.num_envs))
        return self._record_episodes(record, name, cell, environments, policy, starts)

    def _record_episodes(
        self, record: Any, name: str, cell: str, env: Any, policy: Policy, starts: Array | None
    ) -> Rollout:
        """Follow episodes and keep their records, which ``record`` makes."""
        context = EpisodeContext(
            run_id=self.run_id,
            cell=f"{name}/{cell}",
            policy_id=policy.policy_id,
            policy_hash=policy.content_hash,
        )
        recorder = record(env, self.store, context, commit_on_close=False)
        rollout = follow(recorder, policy, starts)
        self._tables.setdefault(name, []).append(recorder.take())
        recorder.close()
        return rollout


class OpenLoop(BoxTask):
    """No reward and no termination; success is to arrive at the end without diverging.

    Made a dataclass for one plant by :func:`open_loop_environment`, which adds the field
    ``control_limit`` in the units of the plant's controls.
    """

    plant: ClassVar[str]
    controls: ClassVar[int]
    observation_names: ClassVar[tuple[str, ...]]
    observation_units: ClassVar[tuple[str, ...]]
    starts: ClassVar[tuple[str, ...]] = ("given",)
    start_options: ClassVar[tuple[str, ...]] = ()
    goal: ClassVar[str] = "no divergence until `duration`"
    goal_stay: ClassVar[float] = 0.0

    @property
    def control_limits(self) -> Limits:
        """The same of every control."""
        return ((-self.control_limit, self.control_limit),) * self.controls

    def observation_limits(self, max_speed: float | None) -> tuple[float, ...]:
        """Unbounded."""
        return (float("inf"),) * len(self.observation_names)

    def observe(self, ops: Ops, q: Components, v: Components) -> Components:
        """The state in state order."""
        return join_state(q, v)

    def share(self, ops: Ops, q: Components, v: Components, squares: Components) -> Component:
        """Nothing."""
        return 0.0 * q[0]

    def at_goal(self, ops: Ops, q: Components, v: Components) -> Component:
        """Wherever it is."""
        return q[0] == q[0]

    def draw_start(self, rng: Any, start: str, options: Mapping[str, Any]) -> Components:
        """Any state: starts are given, and this one follows an episode that has ended."""
        return (1.0, 0.0) * (len(self.observation_names) // 2)


@cache
def open_loop_environment(plant: str) -> type[IntegVectorEnv]:
    """The vector environment of a plant without a task; its ``env_class`` is the single one.

    Args:
        plant: a registered name or ``"module:Class"``.

    Raises:
        ValueError: for a plant that is neither.
    """
    plant_class = PLANTS.load(plant)
    described = {
        "plant": plant,
        "controls": len(plant_class.controls),
        "observation_names": state_names(plant_class),
        "observation_units": state_units(plant_class),
    }
    limit = parameter(1e6, control_unit(plant_class), "saturation of every actuator", positive)
    task = make_dataclass(
        "OpenLoop", [("control_limit", float, limit)], bases=(OpenLoop,), namespace=described,
        frozen=True,
    )  # fmt: skip
    name = f"OpenLoop-{plant_class.name}"
    own = {"task_class": classmethod(lambda cls: task), "defaults": {"integrator": "rk4"}}
    return type(name, (IntegVectorEnv,), {"env_class": type(name, (IntegEnv,), own)})
