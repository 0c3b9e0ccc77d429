"""Rollouts of a diagnosis: run in lanes, kept as arrays, one evidence record each."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from integ_gym.envs.vector import IntegVectorEnv
from integ_gym.eval.diagnosis.open_loop import open_loop_environment
from integ_gym.eval.diagnosis.subject import Subject
from integ_gym.evidence.context import EpisodeContext
from integ_gym.evidence.store import EvidenceStore
from integ_gym.evidence.vector_recorder import RecordVectorEvidence
from integ_gym.train.policy import Policy

Array = npt.NDArray[Any]

SEED = 0
"""Of the first lane's start."""


class Commands:
    """A policy that plays a list of commands, the same in every lane.

    Args:
        name: of the policy.
        values: one per decision, in the plant's unit, shape (decisions,).
    """

    def __init__(self, name: str, values: Array) -> None:
        self.policy_id = name
        self.values = np.asarray(values, dtype=np.float64)
        self.content_hash = hashlib.sha256(self.values.tobytes()).hexdigest()
        self._next = 0

    def act(self, observations: Array) -> Array:
        """The next command for every lane, shape (lanes, 1)."""
        value = self.values[self._next % len(self.values)]
        self._next += 1
        return np.full((len(observations), 1), value)


@dataclass(frozen=True)
class Rollout:
    """Episodes side by side; NaN after the end of an episode.

    Attributes:
        time: control instants, s, shape (instants,).
        state: true states in state order, SI units, shape (instants, lanes, n).
        info: numbers of ``info`` at each instant, shape (instants, lanes), by name.
        success: whether each episode met its task, shape (lanes,).
        returns: sum of rewards, shape (lanes,).
    """

    time: Array
    state: Array
    info: Mapping[str, Array]
    success: Array
    returns: Array

    def total(self, name: str) -> Array:
        """Sum of what was booked under a name, shape (lanes,)."""
        total: Array = np.nansum(self.info[name], axis=0)
        return total

    def residual(self) -> Array:
        """Σ |energy residual| over the control periods, J, shape (lanes,)."""
        total: Array = np.nansum(np.abs(self.info["energy_residual"]), axis=0)
        return total

    def last(self, name: str) -> Array:
        """The last number that is finite, shape (lanes,)."""
        column = self.info[name]
        rows = np.isfinite(column).sum(axis=0) - 1
        values: Array = column[rows, np.arange(column.shape[1])]
        return values

    def diverged(self) -> Array:
        """Whether an episode ended before its time, shape (lanes,)."""
        ended: Array = ~np.isfinite(self.info["energy"][-1])
        return ended


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

    def open_loop(
        self,
        cell: str,
        subject: Subject,
        integrator: str,
        dt: float,
        commands: Commands,
        starts: Array,
        **arguments: Any,
    ) -> Rollout:
        """Follow the bare plant from given starts under given commands.

        Args:
            cell: what the episodes are for, unique within the diagnosis.
            subject: the plant.
            integrator: a registered name or ``"module:Class"``.
            dt: integration step, s.
            commands: one per decision.
            starts: one per lane, state order, shape (lanes, n).
            arguments: further constructor arguments; ``duration`` in s among them.
        """
        made = open_loop_environment(subject.name)(
            len(starts),
            integrator=integrator,
            dt=dt,
            **{"control_period": subject.control_period, **arguments},
        )
        return self._run(cell, made, commands, starts)

    def task(self, cell: str, env_id: str, policy: Policy, lanes: int, **arguments: Any) -> Rollout:
        """Play a registered environment from its own start distribution.

        Args:
            cell: what the episodes are for, unique within the diagnosis.
            env_id: the environment.
            policy: what acts.
            lanes: episodes; lane k starts from seed ``SEED + k``.
            arguments: constructor arguments.
        """
        return self._run(cell, gym.make_vec(env_id, num_envs=lanes, **arguments), policy, None)

    def commit(self, section: str) -> None:
        """Write the records made since the last call, one batch per environment."""
        for name, tables in self._tables.items():
            self.store.commit_all(f"{section}-{name}", tables)
        self._tables.clear()

    def _run(self, cell: str, made: Any, policy: Policy, starts: Array | None) -> Rollout:
        inner: IntegVectorEnv = made.unwrapped
        name = made.spec.id if made.spec else type(inner).__name__
        context = EpisodeContext(
            run_id=self.run_id,
            cell=f"{name}/{cell}",
            policy_id=policy.policy_id,
            policy_hash=policy.content_hash,
        )
        lanes = range(inner.num_envs)
        recorder = RecordVectorEvidence(
            made, self.store, context, episodes=lanes, commit_on_close=False
        )
        rollout = _follow(recorder, inner, policy, starts)
        self._tables.setdefault(name, []).append(recorder.take())
        recorder.close()
        return rollout


def _follow(
    recorder: RecordVectorEvidence, inner: IntegVectorEnv, policy: Policy, starts: Array | None
) -> Rollout:
    timing = inner.setup.timing
    options = None if starts is None else {"state": starts}
    observation, info = recorder.reset(seed=SEED, options=options)
    names = [n for n, x in info.items() if not n.startswith("_") and x.dtype != object]
    state = np.full((timing.horizon + 1, *inner.state.shape), np.nan)
    booked = {name: np.full(state.shape[:2], np.nan) for name in names}
    running = np.ones(inner.num_envs, dtype=bool)
    success, returns = ~running, np.zeros(inner.num_envs)
    for instant in range(timing.horizon + 1):
        state[instant, running] = inner.state[running]
        for name in names:
            booked[name][instant, running] = info[name][running]
        if instant == timing.horizon:
            break
        observation, reward, terminated, truncated, info = recorder.step(policy.act(observation))
        returns[running] += reward[running]
        success |= running & info["success"]
        diverged = info["solver_status"] == "diverged"
        ended = running & (terminated | truncated)
        if instant + 1 < timing.horizon:
            running = running & ~ended
        running = running & ~diverged
        if not running.any():
            break
    time = np.arange(timing.horizon + 1) * timing.control_period
    return Rollout(time, state, booked, success, returns)
