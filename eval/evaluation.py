"""Evaluation of policies over cells, from paired starts, with evidence of every episode."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from integ_gym.eval.cells import Cell, Home
from integ_gym.eval.replays import Successes
from integ_gym.eval.spec import PanelSpec
from integ_gym.evidence.context import EpisodeContext
from integ_gym.evidence.store import EvidenceStore
from integ_gym.evidence.vector_recorder import RecordVectorEvidence
from integ_gym.train.policy.interface import Policy
from integ_gym.train.policy_stack import PolicyStack

Array = npt.NDArray[Any]

OnCell: TypeAlias = Callable[[Cell, int], None]
"""Told of a cell that is finished and of the number of policies in it."""

LATENCY_SAMPLES = 200
"""Decisions at batch size 1 that the inference latency is taken from."""


def quiet(cell: Cell, policies: int) -> None:
    """Tell nobody."""


@dataclass(frozen=True)
class Subject:
    """A policy under evaluation and where it comes from.

    Attributes:
        policy: what acts.
        cells: what it is evaluated in.
        home: discretization or mixture that it was trained on, or None.
        seed: training seed, or None.
    """

    policy: Policy
    cells: tuple[Cell, ...]
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


def conditions_of(spec: PanelSpec) -> Conditions:
    """What all cells of a panel's evaluation share."""
    return Conditions(spec.name, spec.env_id, spec.environment, spec.episodes, spec.episode_seed)


@dataclass(frozen=True)
class Outcomes:
    """What paired episodes came to, arrays of shape (policies, episodes)."""

    success: Array
    returns: Array


class _Played(NamedTuple):
    """A cell whose episodes have been run.

    Attributes:
        cell: the cell.
        places: policies in it.
        recorder: holds the episodes.
    """

    cell: Cell
    places: list[int]
    recorder: RecordVectorEvidence


def evaluate(
    subjects: Sequence[Subject],
    conditions: Conditions,
    store: EvidenceStore,
    batch: str,
    on_cell: OnCell = quiet,
) -> None:
    """Run all policies side by side, cell by cell, and commit all records as one batch.

    A record does not depend on which policies are evaluated together.

    Args:
        subjects: the policies.
        conditions: what all cells share.
        store: where the records go.
        batch: name of the batch, which must not exist yet.
        on_cell: told after every cell which it was and how many policies were in it.
    """
    store.commit_all(batch, _tables(subjects, conditions, store, on_cell))


def _tables(
    subjects: Sequence[Subject],
    conditions: Conditions,
    store: EvidenceStore,
    on_cell: OnCell,
) -> Iterator[Any]:
    """The records of every cell, as soon as the replays are known that label its failures."""
    latencies = inference_latencies(subjects, conditions)
    successes = Successes(
        [subject.home for subject in subjects],
        [subject.cells for subject in subjects],
        conditions.environment,
    )
    waiting: list[_Played] = []
    for cell, places in _schedule(subjects):
        contexts = [
            context_of(subjects[place], cell, conditions, latencies[place]) for place in places
        ]
        recorder = _recorder(cell, contexts, conditions, store)
        policies = [subjects[place].policy for place in places]
        successes.note(cell, places, roll_out(recorder, policies, conditions).success)
        recorder.close()
        on_cell(cell, len(places))
        waiting.append(_Played(cell, places, recorder))
        ready = [played for played in waiting if successes.suffice(played.cell, played.places)]
        waiting = [played for played in waiting if played not in ready]
        for played in ready:
            yield played.recorder.take(successes.replays(played.cell, played.places))


def _schedule(subjects: Sequence[Subject]) -> list[tuple[Cell, list[int]]]:
    """Every cell with the policies that are evaluated in it; those that label others come first."""
    cells = {cell.name: cell for subject in subjects for cell in subject.cells}
    homes = {subject.home for subject in subjects}
    order = sorted(
        cells.values(), key=lambda c: (c.perturbation is not None, c.discretization not in homes)
    )
    names = [{cell.name for cell in subject.cells} for subject in subjects]
    return [
        (cell, [place for place, own in enumerate(names) if cell.name in own]) for cell in order
    ]


def _recorder(
    cell: Cell, contexts: list[EpisodeContext], conditions: Conditions, store: EvidenceStore
) -> RecordVectorEvidence:
    return RecordVectorEvidence(
        _environment(cell, conditions, len(contexts) * conditions.episodes),
        store,
        contexts,
        episodes=[*range(conditions.episodes)] * len(contexts),
        commit_on_close=False,
    )


def roll_out(environment: Any, policies: Sequence[Policy], conditions: Conditions) -> Outcomes:
    """One episode per lane: for each policy one from every paired start."""
    lanes = (len(policies), conditions.episodes)
    stack = PolicyStack(policies)
    first = conditions.episode_seed
    seeds = [*range(first, first + conditions.episodes)] * len(policies)
    observation, _ = environment.reset(seed=seeds)
    running = np.ones(len(seeds), dtype=bool)
    success = np.zeros(len(seeds), dtype=bool)
    returns = np.zeros(len(seeds))
    while running.any():
        actions = stack.act(observation.reshape(*lanes, -1))
        observation, reward, terminated, truncated, info = environment.step(
            actions.reshape(environment.action_space.shape)
        )
        returns[running] += reward[running]
        ended = running & (terminated | truncated)
        success[ended] = info["success"][ended]
        running &= ~ended
    return Outcomes(success.reshape(lanes), returns.reshape(lanes))


def outcomes_in(cell: Cell, policies: Sequence[Policy], conditions: Conditions) -> Outcomes:
    """The paired episodes of one cell, without evidence."""
    environment = _environment(cell, conditions, len(policies) * conditions.episodes)
    outcomes = roll_out(environment, policies, conditions)
    environment.close()
    return outcomes


def inference_latencies(
    subjects: Sequence[Subject], conditions: Conditions
) -> list[tuple[float, float]]:
    """Mean and 99th percentile of the time of one decision at batch size 1, ns, by policy."""
    environment = _environment(subjects[0].cells[0], conditions, 1)
    observation, _ = environment.reset(seed=conditions.episode_seed)
    environment.close()
    return [inference_latency(subject.policy, observation) for subject in subjects]


def inference_latency(policy: Policy, observation: Array) -> tuple[float, float]:
    """Mean and 99th percentile of the time of one decision about observations (1, n), ns."""
    times = []
    for _ in range(LATENCY_SAMPLES):
        start = time.perf_counter_ns()
        policy.act(observation)
        times.append(time.perf_counter_ns() - start)
    return float(np.mean(times)), float(np.percentile(times, 99))


def _environment(cell: Cell, conditions: Conditions, lanes: int) -> Any:
    return gym.make_vec(conditions.env_id, num_envs=lanes, **cell.arguments(conditions.environment))


def context_of(
    subject: Subject, cell: Cell, conditions: Conditions, latency: tuple[float, float]
) -> EpisodeContext:
    """What the episodes of one policy in one cell are for.

    Args:
        subject: the policy.
        cell: where.
        conditions: what all cells share.
        latency: mean and 99th percentile of the time of a decision, ns.
    """
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
