"""Evaluation of one policy over cells, from paired starts, with evidence of every episode."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from integ_gym.envs.registration import environment_setup
from integ_gym.envs.settings import Settings
from integ_gym.eval.cells import Cell, Discretization, Home
from integ_gym.evidence.context import EpisodeContext
from integ_gym.evidence.labels import Replays
from integ_gym.evidence.store import EvidenceStore
from integ_gym.evidence.vector_recorder import RecordVectorEvidence
from integ_gym.train.policy import Policy

Array = npt.NDArray[Any]

LATENCY_SAMPLES = 200
"""Decisions at batch size 1 that the inference latency is taken from."""


@dataclass(frozen=True)
class Subject:
    """A policy under evaluation and where it comes from.

    Attributes:
        policy: what acts.
        home: discretization or mixture that it was trained on, or None.
        seed: training seed, or None.
    """

    policy: Policy
    home: Home | None = None
    seed: int | None = None


@dataclass(frozen=True)
class Conditions:
    """What all cells of an evaluation share.

    Attributes:
        run_id: the run that the records belong to.
        env_id: environment.
        environment: constructor arguments common to all cells.
        episodes: paired starts; episode k starts from seed ``episode_seed + k`` in every cell.
        episode_seed: seed of episode 0.
    """

    run_id: str
    env_id: str
    environment: Mapping[str, Any]
    episodes: int
    episode_seed: int


@dataclass(frozen=True)
class Outcomes:
    """What paired episodes came to, arrays of shape (episodes,)."""

    success: Array
    returns: Array


def evaluate(
    subject: Subject,
    cells: Sequence[Cell],
    conditions: Conditions,
    store: EvidenceStore,
    batch: str,
    on_cell: Callable[[], None] = lambda: None,
) -> None:
    """Run every cell and commit all records as one batch.

    Cells that replay others (the home discretization, the unperturbed environment) must come
    before those that are labelled by them.

    Args:
        subject: the policy.
        cells: in the order in which they are run.
        conditions: what they share.
        store: where the records go.
        batch: name of the batch, which must not exist yet.
        on_cell: called after every cell.
    """
    latency = inference_latency(subject.policy, cells[0], conditions)
    succeeded: dict[tuple[Any, ...], Array] = {}
    tables = []
    for cell in cells:
        environment = _environment(cell, conditions)
        context = _context(subject, cell, conditions, latency)
        recorder = RecordVectorEvidence(
            environment,
            store,
            context,
            episodes=range(conditions.episodes),
            commit_on_close=False,
        )
        success = roll_out(recorder, subject.policy, conditions).success
        tables.append(recorder.take(_replays(subject, cell, conditions, succeeded)))
        succeeded[_key(cell, cell.discretization)] = success
        recorder.close()
        on_cell()
    store.commit_all(batch, tables)


def roll_out(environment: Any, policy: Policy, conditions: Conditions) -> Outcomes:
    """One episode per lane, from the paired starts."""
    count = conditions.episodes
    observation, _ = environment.reset(seed=conditions.episode_seed)
    running = np.ones(count, dtype=bool)
    success = np.zeros(count, dtype=bool)
    returns = np.zeros(count)
    while running.any():
        observation, reward, terminated, truncated, info = environment.step(policy.act(observation))
        returns[running] += reward[running]
        ended = running & (terminated | truncated)
        success[ended] = info["success"][ended]
        running &= ~ended
    return Outcomes(success, returns)


def outcomes_in(cell: Cell, policy: Policy, conditions: Conditions) -> Outcomes:
    """The paired episodes of one cell, without evidence."""
    environment = _environment(cell, conditions)
    outcomes = roll_out(environment, policy, conditions)
    environment.close()
    return outcomes


def inference_latency(policy: Policy, cell: Cell, conditions: Conditions) -> tuple[float, float]:
    """Mean and 99th percentile of the time of one decision at batch size 1, ns."""
    arguments = cell.arguments(conditions.environment)
    environment = gym.make_vec(conditions.env_id, num_envs=1, **arguments)
    observation, _ = environment.reset(seed=conditions.episode_seed)
    environment.close()
    times = []
    for _ in range(LATENCY_SAMPLES):
        start = time.perf_counter_ns()
        policy.act(observation)
        times.append(time.perf_counter_ns() - start)
    return float(np.mean(times)), float(np.percentile(times, 99))


def _environment(cell: Cell, conditions: Conditions) -> Any:
    return gym.make_vec(
        conditions.env_id, num_envs=conditions.episodes, **cell.arguments(conditions.environment)
    )


def _context(
    subject: Subject, cell: Cell, conditions: Conditions, latency: tuple[float, float]
) -> EpisodeContext:
    return EpisodeContext(
        run_id=conditions.run_id,
        cell=cell.name,
        phase="evaluation",
        policy_id=subject.policy.policy_id,
        policy_hash=subject.policy.content_hash,
        training_discretization=subject.home.arguments() if subject.home else None,
        training_seed=subject.seed,
        perturbation=dict(cell.perturbation.environment) if cell.perturbation else None,
        inference_latency_mean=latency[0],
        inference_latency_p99=latency[1],
    )


def _key(cell: Cell, discretization: Discretization | None) -> tuple[Any, ...]:
    return discretization, cell.perturbation.name if cell.perturbation else None


def _replays(
    subject: Subject,
    cell: Cell,
    conditions: Conditions,
    succeeded: Mapping[tuple[Any, ...], Array],
) -> dict[int, Replays]:
    """What the cells run so far say about each episode of this one."""
    at_home = _at_home(subject, cell, succeeded)
    undisturbed = _undisturbed(cell, conditions, succeeded)
    return {
        k: Replays(
            home=_home(subject, cell, at_home, k),
            without_noise=undisturbed["without_noise"][k],
            without_delay=undisturbed["without_delay"][k],
        )
        for k in range(conditions.episodes)
    }


def _at_home(
    subject: Subject, cell: Cell, succeeded: Mapping[tuple[Any, ...], Array]
) -> Array | None:
    """Whether each episode succeeded in one of the training discretizations, once all are run."""
    homes = subject.home.shares if subject.home else ()
    runs = [succeeded.get(_key(cell, home)) for home in homes]
    known = [run for run in runs if run is not None]
    return np.any(known, axis=0) if known and len(known) == len(runs) else None


def _home(subject: Subject, cell: Cell, at_home: Array | None, k: int) -> Any:
    if subject.home is None:
        return "no home"
    if cell.discretization in subject.home.shares:
        return "is home"
    return None if at_home is None else bool(at_home[k])


def _undisturbed(
    cell: Cell, conditions: Conditions, succeeded: Mapping[tuple[Any, ...], Array]
) -> dict[str, Sequence[bool | None]]:
    """The unperturbed cell answers for noise and delays that the perturbation alone brings in."""
    nothing: list[bool | None] = [None] * conditions.episodes
    plain = succeeded.get((cell.discretization, None))
    if cell.perturbation is None or plain is None:
        return {"without_noise": nothing, "without_delay": nothing}
    known = [bool(x) for x in plain]
    return {
        name: known if _only(cell, conditions, owned) else nothing
        for name, owned in (
            ("without_noise", {"observation_noise"}),
            ("without_delay", {"action_latency", "sensor_period"}),
        )
    }


def _only(cell: Cell, conditions: Conditions, names: set[str]) -> bool:
    """Whether the perturbation changes these arguments alone, from their undisturbed values."""
    assert cell.perturbation is not None
    changed = set(cell.perturbation.environment)
    plain = environment_setup(
        conditions.env_id, replace(cell, perturbation=None).arguments(conditions.environment)
    ).settings
    disturbed = any(getattr(plain, name) != getattr(Settings, name) for name in names)
    return changed <= names and not disturbed
