"""Evaluation of policies over cells, from paired starts, with evidence of every episode."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from integ_gym.envs import Testbed, testbed_of
from integ_gym.evidence import EpisodeContext, EvidenceStore, RecordVectorEvidence
from integ_gym.train import Policy, PolicyStack

from ..specification import Cell, Home, PanelSpec, environments_of
from .replays import Successes

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
        first: the first episode that is run.
    """

    run_id: str
    env_id: str
    environment: Mapping[str, Any]
    episodes: int
    episode_seed: int
    first: int = 0

    @property
    def testbed(self) -> Testbed:
        """What makes the environments."""
        return testbed_of(self.env_id, self.environment)

    def divided(self, parts: int) -> list[Conditions]:
        """Parts with a share of the episodes each.

        Only where lanes are run one by one does a record not depend on the division: how many
        observations a network is given at once shows in the last bits of its actions.
        """
        shares = np.array_split(np.arange(self.episodes), min(parts, self.episodes))
        return [replace(self, first=int(own[0]), episodes=len(own)) for own in shares]


def conditions_of(spec: PanelSpec) -> Conditions:
    """What all cells of a panel's evaluation share."""
    return Conditions(spec.name, spec.env_id, spec.environment, spec.episodes, spec.episode_seed)


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
    on_cell: OnCell = quiet,
) -> Iterator[Any]:
    """Run all policies side by side, cell by cell; the records of every cell as a table.

    A table comes as soon as the replays are known that label its failures. A record does not
    depend on which policies are evaluated together.

    Args:
        subjects: the policies.
        conditions: what all cells share.
        store: where the records are meant for; nothing is written.
        on_cell: told after every cell which it was and how many policies were in it.
    """
    latencies = inference_latencies(subjects, conditions)
    successes = Successes(
        [subject.home for subject in subjects],
        [subject.cells for subject in subjects],
        conditions.environment,
        conditions.first,
    )
    waiting: list[_Played] = []
    for cell, places in _schedule(subjects):
        contexts = [
            context_of(subjects[place], cell, conditions, latencies[place]) for place in places
        ]
        recorder = _recorder(cell, contexts, conditions, store)
        policies = [subjects[place].policy for place in places]
        successes.note(cell, places, roll_out(recorder, policies, conditions))
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
    """Lanes for every start of every policy, or for one at a time where each lane costs its own."""
    testbed = conditions.testbed
    together = conditions.episodes if testbed.batched else 1
    return RecordVectorEvidence(
        environments_of(testbed, cell, len(contexts) * together),
        store,
        contexts,
        episodes=[*range(together)] * len(contexts),
        commit_on_close=False,
    )


def roll_out(
    recorder: RecordVectorEvidence, policies: Sequence[Policy], conditions: Conditions
) -> Array:
    """Success of each policy's episode from every paired start, shape (policies, episodes).

    As many starts are run side by side as there are lanes for each policy, the rest after them.
    """
    together = recorder.num_envs // len(policies)
    stack, first = PolicyStack(policies), conditions.first
    rounds = [
        _round(recorder, stack, len(policies), range(start, start + together), conditions)
        for start in range(first, first + conditions.episodes, together)
    ]
    return np.concatenate(rounds, axis=1)


def _round(
    recorder: RecordVectorEvidence,
    stack: PolicyStack,
    policies: int,
    episodes: range,
    conditions: Conditions,
) -> Array:
    """One episode per lane: for each policy one from each of some starts."""
    recorder.assign([*episodes] * policies)
    seeds = [conditions.episode_seed + episode for episode in episodes] * policies
    observation, _ = recorder.reset(seed=seeds)
    running = np.ones(len(seeds), dtype=bool)
    success = np.zeros(len(seeds), dtype=bool)
    while running.any():
        actions = stack.act(observation.reshape(policies, len(episodes), -1))
        observation, _, terminated, truncated, info = recorder.step(
            actions.reshape(recorder.action_space.shape)
        )
        ended = running & (terminated | truncated)
        success[ended] = info["success"][ended]
        running &= ~ended
    return success.reshape(policies, len(episodes))


def inference_latencies(
    subjects: Sequence[Subject], conditions: Conditions
) -> list[tuple[float, float]]:
    """Mean and 99th percentile of the time of one decision at batch size 1, ns, by policy."""
    environments = environments_of(conditions.testbed, subjects[0].cells[0], 1)
    observation, _ = environments.reset(seed=conditions.episode_seed)
    environments.close()
    return [inference_latency(subject.policy, observation) for subject in subjects]


def inference_latency(policy: Policy, observation: Array) -> tuple[float, float]:
    """Mean and 99th percentile of the time of one decision about observations (1, n), ns."""
    times = []
    for _ in range(LATENCY_SAMPLES):
        start = time.perf_counter_ns()
        policy.act(observation)
        times.append(time.perf_counter_ns() - start)
    return float(np.mean(times)), float(np.percentile(times, 99))


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
