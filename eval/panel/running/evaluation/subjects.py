"""Evaluation of policies over cells, from paired starts, with evidence of every episode."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from gymnasium.vector import VectorEnv

from integ_gym.envs import DiscretizedVectorEnv
from integ_gym.evidence import EpisodeContext, EvidenceStore, RecordVectorEvidence
from integ_gym.support import report_work
from integ_gym.train import Policy, PolicyStack

from ...specification import Cell, Home, PanelSpec, environments_of
from ..costs import cell_seconds
from .replays import Successes, with_what_they_rest_on

Array = npt.NDArray[Any]
Flags = npt.NDArray[np.bool_]

LATENCY_SAMPLES = 200
"""Decisions at batch size 1 that the inference latency is taken from."""


@dataclass(frozen=True)
class Subject:
    """A policy under evaluation and where it comes from.

    Attributes:
        policy: what acts.
        cells: what it is evaluated in.
        home: discretization or mixture that it was trained on, or None.
        seed: training seed, or None.
        starts: training seed whose starts it acts from.
        home_known: whether ``home`` tells all; False for what was trained nobody says where.
        recorded: cells, by name, of which there are records; they are run again only where
            labels in others rest on them.
        at_home: earlier episodes in what it was trained on: of how many of how many it succeeded,
            by cell.
    """

    policy: Policy
    cells: tuple[Cell, ...]
    home: Home | None = None
    seed: int | None = None
    starts: int = 0
    home_known: bool = True
    recorded: frozenset[str] = frozenset()
    at_home: Mapping[str, tuple[int, int]] = field(default_factory=dict)

    @property
    def missing(self) -> tuple[Cell, ...]:
        """Cells without records."""
        return tuple(cell for cell in self.cells if cell.name not in self.recorded)

    def waiting(self, recorded: Iterable[str]) -> Subject:
        """The same with the cells alone that are wanted where there are records of some."""
        told = replace(self, recorded=frozenset(recorded))
        return replace(told, cells=with_what_they_rest_on(told.missing, self.cells, self.home))


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


def divided(spec: PanelSpec, parts: int) -> list[range]:
    """The episodes of a panel that came last, in parts of about one size.

    Only where lanes are run one by one does a record not depend on the division: how many
    observations a network is given at once shows in the last bits of its actions.
    """
    shares = np.array_split(spec.latest, min(parts, len(spec.latest)))
    return [range(own[0], own[-1] + 1) for own in shares]


def evaluate(
    spec: PanelSpec,
    subjects: Sequence[Subject],
    episodes: range,
    store: EvidenceStore,
    statuses: Mapping[str, str],
) -> Iterator[Any]:
    """Run all policies side by side, cell by cell; the records of every cell as a table.

    A table comes as soon as the replays are known that label its failures, and a cell's work is
    reported when it is done. A record does not depend on which policies are evaluated together.

    Args:
        spec: the panel.
        subjects: the policies, with records of the same cells.
        episodes: those to run, the same starts in every cell; see :meth:`PanelSpec.start_seed`.
        store: where the records are meant for; nothing is written.
        statuses: whether a cell can be solved, by its name.
    """
    (recorded,) = {subject.recorded for subject in subjects}
    latencies = inference_latencies(spec, subjects)
    successes = Successes(
        [subject.home for subject in subjects],
        [subject.cells for subject in subjects],
        spec.environment,
        episodes.start,
        statuses,
        whole=spec.testbed.batched,
        before=[subject.at_home for subject in subjects],
        homeless=[place for place, subject in enumerate(subjects) if not subject.home_known],
    )
    waiting: list[_Played] = []
    for cell, places in _schedule(subjects):
        contexts = [context_of(spec, subjects[place], cell, latencies[place]) for place in places]
        recorder = _recorder(spec, cell, contexts, episodes, store)
        own = [subjects[place] for place in places]
        success = roll_out(spec, recorder, own, episodes)
        successes.note(cell, places, success, second_horizon(spec, cell, own, episodes, success))
        recorder.close()
        report_work(len(episodes) / spec.episodes * len(places) * cell_seconds(spec, cell))
        if cell.name not in recorded:
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
    spec: PanelSpec,
    cell: Cell,
    contexts: list[EpisodeContext],
    episodes: range,
    store: EvidenceStore,
) -> RecordVectorEvidence:
    """What runs the policies in a cell, and keeps their episodes."""
    together = _together(spec, episodes)
    return RecordVectorEvidence(
        environments_of(spec.testbed, cell, len(contexts) * together),
        store,
        contexts,
        episodes=[*range(together)] * len(contexts),
        commit_on_close=False,
    )


def _together(spec: PanelSpec, episodes: range) -> int:
    """How many starts of a policy have lanes at once: all, or one where each lane costs its own."""
    return len(episodes) if spec.testbed.batched else 1


def success_of(
    spec: PanelSpec, cell: Cell, subjects: Sequence[Subject], episodes: range, **changed: Any
) -> Flags:
    """Success of each policy's episode in a cell, shape (policies, episodes); no record is kept.

    Args:
        spec: the panel.
        cell: where.
        subjects: the policies.
        episodes: those to run.
        changed: arguments that differ from the cell's.
    """
    lanes = len(subjects) * _together(spec, episodes)
    environments = environments_of(spec.testbed, cell, lanes, **changed)
    success = roll_out(spec, environments, subjects, episodes)
    environments.close()
    return success


def roll_out(
    spec: PanelSpec,
    environments: DiscretizedVectorEnv | RecordVectorEvidence,
    subjects: Sequence[Subject],
    episodes: range,
) -> Flags:
    """Success of each policy's episode from every start of its own, shape (policies, episodes).

    As many starts are run side by side as there are lanes for each policy, the rest after them.
    """
    together = environments.num_envs // len(subjects)
    stack = PolicyStack([subject.policy for subject in subjects])
    rounds = []
    for done in range(0, len(episodes), together):
        part = episodes[done : done + together]
        if isinstance(environments, RecordVectorEvidence):
            environments.assign([*part] * len(subjects))
        seeds = [spec.start_seed(subject.starts, k) for subject in subjects for k in part]
        rounds.append(_round(environments, stack, seeds, len(subjects)))
    return np.concatenate(rounds, axis=1)


def _round(
    environments: VectorEnv[Any, Any, Any], stack: PolicyStack, seeds: list[int], policies: int
) -> Flags:
    """One episode per lane, for each policy as many; whether it succeeds."""
    observation, _ = environments.reset(seed=seeds)  # type: ignore[arg-type]
    running = np.ones(len(seeds), dtype=bool)
    success = np.zeros(len(seeds), dtype=bool)
    while running.any():
        actions = stack.act(observation.reshape(policies, len(seeds) // policies, -1))
        observation, _, terminated, truncated, info = environments.step(
            actions.reshape(environments.action_space.shape)
        )
        ended = running & (terminated | truncated)
        success[ended] = info["success"][ended]
        running &= ~ended
    return success.reshape(policies, -1)


def second_horizon(
    spec: PanelSpec, cell: Cell, subjects: Sequence[Subject], episodes: range, success: Flags
) -> Flags | None:
    """Which episodes succeed within one horizon or two, shape (policies, episodes).

    Policies that failed once act again from all their starts, for twice the duration; None where
    the testbed's horizon is fixed.
    """
    testbed = spec.testbed
    if testbed.horizon is None:
        return None
    recovered, failing = success.copy(), np.flatnonzero(~success.all(axis=1)).tolist()
    if failing:
        twice = {testbed.horizon: 2.0 * spec.nominal.settings.duration}
        own = [subjects[place] for place in failing]
        recovered[failing] |= success_of(spec, cell, own, episodes, **twice)
    return recovered


def inference_latencies(spec: PanelSpec, subjects: Sequence[Subject]) -> list[tuple[float, float]]:
    """Mean and 99th percentile of the time of one decision at batch size 1, ns, by policy."""
    environments = environments_of(spec.testbed, subjects[0].cells[0], 1)
    observation, _ = environments.reset(seed=spec.start_seed(subjects[0].starts, 0))
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
    spec: PanelSpec, subject: Subject, cell: Cell, latency: tuple[float, float]
) -> EpisodeContext:
    """What the episodes of one policy in one cell are for.

    Args:
        spec: the panel.
        subject: the policy.
        cell: where.
        latency: mean and 99th percentile of the time of a decision, ns.
    """
    return EpisodeContext(
        run_id=spec.name,
        cell=cell.name,
        phase="evaluation",
        policy_id=subject.policy.policy_id,
        policy_hash=subject.policy.content_hash,
        training_discretization=subject.home.arguments() if subject.home else None,
        training_seed=subject.seed,
        home_known=subject.home_known,
        perturbation=dict(cell.perturbation.environment) if cell.perturbation else None,
        trace_every=spec.trace_every,
        inference_latency_mean=latency[0],
        inference_latency_p99=latency[1],
    )
