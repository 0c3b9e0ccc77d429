"""Episodes of policies in cells from paired starts, and what they say of each other's failures."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import InitVar, dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, VectorEnv

from integ_gym.envs.lanes import DiscretizedVectorEnv
from integ_gym.envs.ops.ops import Array
from integ_gym.envs.settings import DELAYS, Discretization, Settings
from integ_gym.evidence.fields import ATTEMPT, LATER_ATTEMPT, SECOND_HORIZON
from integ_gym.evidence.labels import EpisodeContext, Replays
from integ_gym.evidence.labels import Home as HomeReplay
from integ_gym.evidence.store import EvidenceStore
from integ_gym.evidence.vector_recorder import RecordVectorEvidence
from integ_gym.support.interpreters import PACKAGES, are_running, call_there, describe_versions
from integ_gym.support.processes import report_work
from integ_gym.train.policy import Policy, PolicyStack, start_acting

from .cells import Cell, Home, environments_of, place_arguments
from .contracts import Contracts, is_kept
from .costs import cell_seconds
from .elsewhere import interpreter_for, other_packages
from .spec import PanelSpec

Flags = npt.NDArray[np.bool_]
Key = tuple[Discretization, str | None]

_DISTURBANCES = {
    "without_noise": {"observation_noise"},
    "without_delay": {*DELAYS, "sensor_period"},
}
"""Replays to the arguments that they do without."""


@dataclass
class Successes:
    """Which episodes succeeded, policy by policy and cell by cell.

    Attributes:
        homes: training discretization or mixture of every policy, or None.
        cells: cells that every policy is evaluated in.
        environment: constructor arguments common to all cells.
        first: index of the first episode of every cell.
        statuses: whether a cell can be solved, by its name; see
            :data:`integ_gym.evidence.fields.CELL_STATUSES`.
        whole: whether every policy's episodes at home are all here, so that its success there is
            known.
        homeless: policies of which it is unknown where they were trained.
        before: of every policy, of how many of how many earlier episodes at home it succeeded, by
            cell.
        known: success in cells that are not among these, by policy and cell.
        contracts: what was compared of homes and cells on other engines.
    """

    homes: Sequence[Home | None]
    cells: InitVar[Sequence[Sequence[Cell]]]
    environment: Mapping[str, Any]
    first: int = 0
    statuses: Mapping[str, str] = field(default_factory=dict)
    whole: bool = True
    homeless: Collection[int] = ()
    before: Sequence[Mapping[Discretization, tuple[int, int]]] = ()
    known: dict[tuple[int, Key], Flags] = field(default_factory=dict)
    contracts: Contracts = field(default_factory=dict)

    def __post_init__(self, cells: Sequence[Sequence[Cell]]) -> None:
        self._awaited = [{_key(cell) for cell in own} for own in cells]
        self._recovered: dict[tuple[int, Key], Flags | None] = {}

    def note(
        self, cell: Cell, policies: Sequence[int], success: Flags, recovered: Flags | None
    ) -> None:
        """Take in a cell's outcomes, shape (policies, episodes), within one horizon and two."""
        for i, place in enumerate(policies):
            self.known[place, _key(cell)] = success[i]
            self._recovered[place, _key(cell)] = None if recovered is None else recovered[i]
            self._awaited[place].discard(_key(cell))

    def suffice(self, cell: Cell, policies: Sequence[int]) -> bool:
        """Whether all replays that labels in the cell rest on have been run, of those that will."""
        needed = ((p, _rests_on(cell, self.homes[p])) for p in policies)
        return all(self._awaited[p].isdisjoint(keys) for p, keys in needed)

    def replays(self, cell: Cell, policies: Sequence[int]) -> list[dict[int, Replays]]:
        """What is known about each episode of a cell that was noted, policy by policy."""
        return [self._replays_of(cell, place) for place in policies]

    def _replays_of(self, cell: Cell, place: int) -> dict[int, Replays]:
        home, key = self.homes[place], (place, _key(cell))
        said: dict[str, Any] = {
            "home": self._find_home_success(cell, place),
            "second_horizon": self._recovered[key],
        }
        # The cell without changes, which is one with the packages that run here, answers for noise
        # and delays that a variation brings in.
        plain = self.known.get((place, (cell.discretization, None)))
        for replay, names in _DISTURBANCES.items():
            said[replay] = plain if self._changes_only(cell, names) else None
        whole: dict[str, Any] = {
            "home_success": self._home_success(place),
            "cell_status": self.statuses.get(cell.name),
            "contract_kept": is_kept(self.contracts, () if home is None else home.shares, cell),
        }
        return {
            self.first + k: Replays(**{n: _episode(x, k) for n, x in said.items()}, **whole)
            for k in range(len(self.known[key]))
        }

    def _home_success(self, place: int) -> float | None:
        """Success in what the policy was trained on, by shares; None where that was not run.

        Earlier episodes are among those that count.
        """
        home, parts = self.homes[place], []
        if home is None or not self.whole:
            return None
        for member, share in home.shares.items():
            flags = self.known.get((place, (member, None)))
            if flags is None:
                return None
            earlier = self.before[place] if self.before else {}
            succeeded, episodes = earlier.get(member, (0, 0))
            parts.append(share * ((succeeded + int(flags.sum())) / (episodes + flags.size)))
        return sum(parts)

    def _find_home_success(self, cell: Cell, place: int) -> Flags | HomeReplay:
        """Whether each episode succeeded in one of the training discretizations, all being run."""
        home = self.homes[place]
        if home is None:
            return None if place in self.homeless else "no home"
        if cell.discretization in home.shares:
            return "is home"
        runs = [self.known.get((place, (d, cell.changes))) for d in home.shares]
        known = [run for run in runs if run is not None]
        return np.any(known, axis=0) if len(known) == len(runs) else None

    def _changes_only(self, cell: Cell, names: set[str]) -> bool:
        """Whether these arguments alone are changed, from their undisturbed values."""
        changed = {*cell.environment} - {PACKAGES}
        if not changed or not changed <= names:
            return False
        plain = place_arguments(cell.discretization, self.environment)
        return all(plain.get(n, getattr(Settings, n)) == getattr(Settings, n) for n in names)


def _rests_on(cell: Cell, home: Home | None) -> set[Key]:
    shares = () if home is None else home.shares
    at_home = {(d, disturbance) for d in shares for disturbance in (cell.changes, None)}
    return {*at_home, (cell.discretization, None)} - {_key(cell)}


def _key(cell: Cell) -> Key:
    return cell.discretization, cell.changes


def _episode(said: Flags | HomeReplay, episode: int) -> Any:
    return bool(said[episode]) if isinstance(said, np.ndarray) else said


Numbers = Callable[[int, int], int]

LATENCY_SAMPLES = 200
"""Decisions at batch size 1 that the inference latency is taken from."""

_LATENCIES: dict[tuple[str, ...], tuple[float, float]] = {}
"""What :func:`inference_latencies` has measured, by environment, policy and its hash."""


def _has_own_packages(cell: Cell) -> bool:
    """Whether a cell has other package versions than this interpreter."""
    return not are_running(cell.packages)


@dataclass(frozen=True)
class Subject:
    """A policy under evaluation and where it comes from.

    Attributes:
        policy: what acts.
        cells: what it is evaluated in.
        home: discretization or mixture that it was trained on, or None.
        seed: training seed, or None.
        starts: training seed whose starts it acts from.
        home_known: whether ``home`` is all there is to know; False where the training is unknown.
        recorded: success of the episodes in cells of which there are records, by their names;
            labels in other cells may rest on it.
        at_home: earlier episodes in what it was trained on: of how many of how many it succeeded.
    """

    policy: Policy
    cells: tuple[Cell, ...]
    home: Home | None = None
    seed: int | None = None
    starts: int = 0
    home_known: bool = True
    recorded: Mapping[str, Flags] = field(default_factory=dict)
    at_home: Mapping[Discretization, tuple[int, int]] = field(default_factory=dict)

    @property
    def missing(self) -> tuple[Cell, ...]:
        """Cells without records."""
        return tuple(cell for cell in self.cells if cell.name not in self.recorded)

    @property
    def trained_on(self) -> tuple[Discretization, ...]:
        """The discretizations that it was trained on, as far as they are known."""
        return () if self.home is None else tuple(self.home.shares)

    @property
    def known(self) -> dict[Key, Flags]:
        """Success in the cells with records."""
        own = (cell for cell in self.cells if cell.name in self.recorded)
        return {_key(cell): self.recorded[cell.name] for cell in own}

    def can_label(self, cell: Cell) -> bool:
        """Whether there are records of all other cells of its own that labels in one rest on."""
        missing = {_key(one) for one in self.missing}
        rests_on: set[Key] = {(cell.discretization, None)}
        if cell.discretization not in self.trained_on:
            rests_on |= _rests_on(cell, self.home)
        return missing.isdisjoint(rests_on - {_key(cell)})

    def within(self, packages: tuple[str, ...]) -> Subject:
        """The same, of cells without records only with those that have these versions, or, with
        none, those that are here."""
        return self.among(
            c.name
            for c in self.cells
            if c.packages == packages or not (packages or _has_own_packages(c))
        )

    def among(self, names: Iterable[str]) -> Subject:
        """The same, of cells without records only with some."""
        chosen = {*names, *self.recorded}
        return replace(self, cells=tuple(cell for cell in self.cells if cell.name in chosen))


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
    known: Mapping[tuple[int, Key], Flags] | None = None,
    contracts: Contracts | None = None,
) -> Iterator[Any]:
    """Run all policies side by side, cell by cell; the records of every cell as a table.

    Cells with other package versions come last, each in an interpreter that has them.

    A table comes as soon as the replays are known that label its failures, and a cell's work is
    reported when it is done. A record does not depend on which policies are evaluated together.

    Args:
        spec: the panel.
        subjects: the policies.
        episodes: those to run, the same starts in every cell; see :meth:`PanelSpec.start_seed`.
        store: where the records are meant for; nothing is written.
        statuses: whether a cell can be solved, by its name.
        known: success in other cells, by policy and cell, that labels may rest on.
        contracts: what was compared of homes and cells on other engines.
    """
    everywhere = subjects
    subjects = [subject.within(()) for subject in everywhere]
    these = slice(episodes.start - spec.latest.start, episodes.stop - spec.latest.start)
    on_record = {
        (place, key): success[these]
        for place, subject in enumerate(subjects)
        for key, success in subject.known.items()
    }
    latencies = inference_latencies(spec, subjects)
    successes = Successes(
        [subject.home for subject in subjects],
        [subject.missing for subject in subjects],
        spec.environment,
        episodes.start,
        statuses,
        whole=spec.testbed.batched,
        before=[subject.at_home for subject in subjects],
        homeless=[place for place, subject in enumerate(subjects) if not subject.home_known],
        known={**on_record, **(known or {})},
        contracts=contracts or {},
    )
    waiting: list[_Played] = []
    for cell, places in _schedule(subjects):
        own, times = [subjects[place] for place in places], [latencies[place] for place in places]
        contexts = [context_of(spec, *one, cell) for one in zip(own, times, strict=True)]
        recorder, success = _record_episodes(spec, cell, own, episodes, contexts, store)
        recovered, later = _second_horizon(spec, cell, own, episodes, success, times, store)
        successes.note(cell, places, success, recovered)
        report_work(len(episodes) / spec.episodes * len(places) * cell_seconds(spec, cell))
        waiting.append(_Played(cell, places, recorder))
        if later is not None:
            yield later.take()
        ready = [played for played in waiting if successes.suffice(played.cell, played.places)]
        waiting = [played for played in waiting if played not in ready]
        for played in ready:
            yield played.recorder.take(successes.replays(played.cell, played.places))
    for packages in other_packages(cell for subject in everywhere for cell in subject.missing):
        within = [subject.within(packages) for subject in everywhere]
        at = [place for place, own in enumerate(within) if own.missing]
        there = [replace(within[place], cells=within[place].missing, recorded={}) for place in at]
        cells = [cell for subject in there for cell in subject.cells]
        policies = [subject.policy for subject in there]
        interpreter = interpreter_for(packages, spec, cells, policies)
        renumbered = {
            (at.index(place), key): success
            for (place, key), success in successes.known.items()
            if place in at
        }
        yield from call_there(
            interpreter, evaluate, spec, there, episodes, store, statuses, renumbered
        )


def _schedule(subjects: Sequence[Subject]) -> list[tuple[Cell, list[int]]]:
    """Every cell without records, with the policies in it; those that label others come first."""
    cells = {cell.name: cell for subject in subjects for cell in subject.missing}
    names = [{cell.name for cell in subject.missing} for subject in subjects]
    homes = {home for subject in subjects for home in subject.trained_on}
    return [
        (cell, [place for place, own in enumerate(names) if cell.name in own])
        for cell in sorted(cells.values(), key=lambda cell: depth(cell, homes))
    ]


def depth(cell: Cell, homes: Collection[Discretization]) -> tuple[bool, int]:
    """How late a cell comes: labels in it rest on cells of less depth, if ``homes`` are a policy's
    own; see :func:`_rests_on`."""
    others = (cell.changes is not None) + (cell.discretization not in homes)
    return _has_own_packages(cell), others


def _record_episodes(
    spec: PanelSpec,
    cell: Cell,
    subjects: Sequence[Subject],
    episodes: range,
    contexts: Sequence[EpisodeContext],
    store: EvidenceStore,
    numbers: Numbers | None = None,
    **changed: Any,
) -> tuple[RecordVectorEvidence, Flags]:
    """Episodes of policies in a cell, and their success, shape (policies, episodes).

    Args:
        spec: the panel.
        cell: where.
        subjects: the policies.
        episodes: those to run.
        contexts: what they are for, one of each policy or one of all.
        store: where the records are meant for; nothing is written.
        numbers: from a policy's place and its episode to the record's episode index; by default
            the latter.
        changed: arguments that differ from the cell's.
    """
    lanes = len(subjects) * _together(spec, cell, episodes, len(subjects))
    if not spec.testbed.batched:
        changed = {**changed, "autoreset_mode": AutoresetMode.DISABLED}
    recorder = RecordVectorEvidence(
        environments_of(spec.testbed, cell, lanes, **changed),
        store,
        contexts,
        episodes=[*range(lanes // len(contexts))] * len(contexts),
        commit_on_close=False,
    )
    success = roll_out(spec, recorder, subjects, episodes, numbers)
    recorder.close()
    return recorder, success


def _together(spec: PanelSpec, cell: Cell, episodes: range, policies: int) -> int:
    """How many starts of a policy have lanes at once: all, or as many as its testbed has room for.

    These are divided evenly.
    """
    room, arguments = len(episodes), {**spec.environment, **cell.environment}
    if not spec.testbed.batched:
        own = getattr(spec.testbed, "room", None)
        room = own(cell.discretization, arguments, policies) if own else 1
    return math.ceil(len(episodes) / math.ceil(len(episodes) / room))


def roll_out(
    spec: PanelSpec,
    environments: DiscretizedVectorEnv | RecordVectorEvidence,
    subjects: Sequence[Subject],
    episodes: range,
    numbers: Numbers | None = None,
) -> Flags:
    """Success of each policy's episode from every start of its own, shape (policies, episodes).

    As many starts are run side by side as there are lanes for each policy, the rest after them.
    """
    together = environments.num_envs // len(subjects)
    rounds = []
    for done in range(0, len(episodes), together):
        part = episodes[done : done + together]
        lanes = [*part, *episodes[: together - len(part)]]  # the latter are not run
        if isinstance(environments, RecordVectorEvidence):
            own = [(place, k) for place in range(len(subjects)) for k in lanes]
            environments.assign([k if numbers is None else numbers(place, k) for place, k in own])
        seeds = [spec.start_seed(subject.starts, k) for subject in subjects for k in lanes]
        running = np.tile(np.arange(together) < len(part), len(subjects))
        stack = PolicyStack([subject.policy for subject in subjects], spec.testbed.batched)
        rounds.append(_round(environments, stack, seeds, running)[:, : len(part)])
    return np.concatenate(rounds, axis=1)


def _round(
    environments: VectorEnv[Any, Any, Any], stack: PolicyStack, seeds: list[int], running: Flags
) -> Flags:
    """One episode in each of some lanes, for each policy as many; whether it succeeds.

    Where lanes are run one by one, nothing is asked about those that rest.
    """
    options = None if running.all() else {"reset_mask": running.copy()}
    observation, _ = environments.reset(seed=seeds, options=options)  # type: ignore[arg-type]
    success = np.zeros(len(seeds), dtype=bool)
    policies, shape = stack.count, environments.action_space.shape or ()
    while running.any():
        asked = None if stack.batched else running.reshape(policies, -1)
        actions = stack.act(observation.reshape(policies, len(seeds) // policies, -1), asked)
        observation, _, terminated, truncated, info = environments.step(actions.reshape(shape))
        ended = running & (terminated | truncated)
        success[ended] = info["success"][ended]
        running &= ~ended
    return success.reshape(policies, -1)


def _second_horizon(
    spec: PanelSpec,
    cell: Cell,
    subjects: Sequence[Subject],
    episodes: range,
    success: Flags,
    latencies: Sequence[tuple[float, float]],
    store: EvidenceStore,
) -> tuple[Flags | None, RecordVectorEvidence | None]:
    """Which episodes succeed within one horizon or two, shape (policies, episodes), and the second.

    Policies that failed once act again from all their starts, for twice the duration; None where
    the testbed's horizon is fixed.
    """
    twice = spec.twice_the_time
    if twice is None:
        return None, None
    recovered, failing = success.copy(), np.flatnonzero(~success.all(axis=1)).tolist()
    if not failing:
        return recovered, None
    own = [subjects[place] for place in failing]
    contexts = [
        context_of(spec, subjects[k], latencies[k], cell, SECOND_HORIZON, spec.episodes)
        for k in failing
    ]
    recorder, later = _record_episodes(spec, cell, own, episodes, contexts, store, None, **twice)
    recovered[failing] |= later
    return recovered, recorder


def attempts(
    spec: PanelSpec, cell: Cell, controller: Policy, store: EvidenceStore
) -> tuple[Flags, Flags, list[Any]]:
    """What a controller does in a cell from the starts of several seeds that came last.

    Returns:
        Success within the horizon, and within one horizon or two, shape (sets of starts,
        episodes), and the records as tables.
    """
    subjects = [Subject(controller, (cell,), starts=starts) for starts in spec.start_sets]
    every = len(subjects) * spec.episodes

    def play(own: list[int], phase: str, **changed: Any) -> tuple[RecordVectorEvidence, Flags]:
        context = context_of(spec, subjects[0], None, cell, phase, every)
        trying = [subjects[place] for place in own]
        return _record_episodes(
            spec, cell, trying, spec.latest, [context], store,
            lambda place, episode: spec.attempt(own[place], episode), **changed,
        )  # fmt: skip

    recorder, success = play([*range(len(subjects))], ATTEMPT)
    tables, recovered = [recorder.take()], success.copy()
    failing = np.flatnonzero(~success.all(axis=1)).tolist()
    if failing and spec.twice_the_time is not None:
        recorder, later = play(failing, LATER_ATTEMPT, **spec.twice_the_time)
        tables.append(recorder.take())
        recovered[failing] |= later
    return success, recovered, tables


def inference_latencies(spec: PanelSpec, subjects: Sequence[Subject]) -> list[tuple[float, float]]:
    """Mean and 99th percentile of the time of one decision at batch size 1, ns, by policy.

    A process measures each policy once in an environment. Nothing where there is no cell.
    """
    cell = next((cell for subject in subjects for cell in subject.missing), None)
    if cell is None:
        return []
    policies = [subject.policy for subject in subjects]
    where = spec.env_id, repr(spec.environment)
    keys = [(*where, policy.policy_id, policy.content_hash) for policy in policies]
    if new := {*keys} - _LATENCIES.keys():
        environments = environments_of(spec.testbed, cell, 1)
        observation, _ = environments.reset(seed=spec.start_seed(subjects[0].starts, 0))
        environments.close()
        own = dict(zip(keys, policies, strict=True))
        _LATENCIES.update((key, inference_latency(own[key], observation)) for key in new)
    return [_LATENCIES[key] for key in keys]


def inference_latency(policy: Policy, observation: Array) -> tuple[float, float]:
    """Mean and 99th percentile of the time of one decision about observations (1, n), ns."""
    times, act = [], start_acting(policy)
    for _ in range(LATENCY_SAMPLES):
        start = time.perf_counter_ns()
        act(observation)
        times.append(time.perf_counter_ns() - start)
    return float(np.mean(times)), float(np.percentile(times, 99))


def context_of(
    spec: PanelSpec,
    subject: Subject,
    latency: tuple[float, float] | None,
    cell: Cell,
    phase: str = "evaluation",
    trace_every: int | None = None,
) -> EpisodeContext:
    """What the episodes of one policy in one cell are for.

    Args:
        spec: the panel.
        subject: the policy.
        latency: mean and 99th percentile of the time of a decision, ns; None: not measured.
        cell: where.
        phase: of the records.
        trace_every: episodes whose index is a multiple of it have a trace; by default the panel's.
    """
    return EpisodeContext(
        run_id=spec.name,
        cell=cell.name,
        phase=phase,
        policy_id=subject.policy.policy_id,
        policy_hash=subject.policy.content_hash,
        training_discretization=subject.home.arguments() if subject.home else None,
        training_seed=subject.seed,
        home_known=subject.home_known,
        perturbation=cell.environment or None,
        packages=describe_versions(cell.packages),
        trace_every=trace_every or spec.trace_every,
        inference_latency_mean=None if latency is None else latency[0],
        inference_latency_p99=None if latency is None else latency[1],
    )
