"""The bench of a diagnosis: whatever is followed on it leaves evidence records."""

from __future__ import annotations

import hashlib
import math
from dataclasses import replace
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np

from integ_gym.envs import numerics
from integ_gym.evidence.context import EpisodeContext
from integ_gym.evidence.recorder import RecordEvidence
from integ_gym.evidence.store import EvidenceStore
from integ_gym.evidence.vector_recorder import RecordVectorEvidence
from integ_gym.train.policy import Policy

from .counting import counted
from .open_loop import open_loop_environment
from .rollout import Array, Rollout, follow
from .subject import Subject

_MOST_DECISIONS = 64
"""A motion of more steps at a constant control is recorded at every so many of them."""


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
            starts: one per lane, state order, shape (lanes, n); of a single one evaluations of the
                plant are counted.
            arguments: further constructor arguments; ``duration`` in s among them.
        """
        made = open_loop_environment(subject.name)
        arguments = {
            "control_period": subject.control_period, **arguments,
            "integrator": integrator, "dt": dt,
        }  # fmt: skip
        if len(starts) > 1:
            return self._lanes(cell, made(len(starts), **arguments), commands, starts)
        env = made.env_class(**arguments)
        system = counted(env)
        rollout = self._recorded(RecordEvidence, made.__name__, cell, env, commands, starts[0])
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
            rollout = self.open_loop(
                f"{cell}/{next(count)}", subject, integrator, dt,
                Commands("constant", np.array([control])), np.asarray(state)[None],
                control_period=period, duration=decisions * period, **subject.undamped,
            )  # fmt: skip
            end: Array = rollout.state[-1, 0]
            return end

        return advance

    def commit(self, section: str) -> None:
        """Write the records made since the last call, one batch per environment."""
        for name, tables in self._tables.items():
            self.store.commit_all(f"{section}-{name}", tables)
        self._tables.clear()

    def _lanes(self, cell: str, made: Any, policy: Policy, starts: Array | None) -> Rollout:
        name = made.spec.id if made.spec else type(made).__name__
        record = partial(RecordVectorEvidence, episodes=range(made.num_envs))
        return self._recorded(record, name, cell, made, policy, starts)

    def _recorded(
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
