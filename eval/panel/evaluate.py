"""Evaluation as units of work: policies in cells, each finished by one atomic commit.

Which policies share a unit depends on cores and memory. A unit's marker lists its policies with
their hashes, so that another division goes on where an interrupted one ended. A unit has the
starts that came at a time (:meth:`PanelSpec.parts`): where a panel is meant, its last part is.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from integ_gym.envs.engines.stepping import engine_versions
from integ_gym.evidence.episodes import Layout
from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.executors import Cluster
from integ_gym.support.processes import release_memory
from integ_gym.support.terminal import WorkBar

from .achieve import Tried, not_tried, tried, try_cells
from .cells import Cell
from .contracts import Contracts, compare_engines, contracts_in, not_compared
from .costs import cell_seconds, cell_timing, trying_seconds
from .episodes import Subject, depth, divided, evaluate
from .plan import inputs
from .run_directory import RunDirectory, first_of, key_of, name_start
from .spec import PanelSpec
from .training import preparation_of
from .units import Work, open_work

PREFIX = "evaluate-"

LONGEST = 60.0
"""What a batch should take at most, s."""

ROUND = 10.0
"""What the cells of a unit should take at most where lanes are not all advanced at once, s: an
episode of a robot takes 1 to 3 MB."""

MEMORY = 1 << 30
"""What the episodes of a batch may take, bytes."""

COPIES = 8
"""How often a cell's rows are in memory: as they come, by episode, as a table, as a row group, and
twice as many while those that failed have twice the time."""

HANDED_OVER = 40e6
"""What the episodes that a worker hands over at once may take, bytes: the worker holds them several
times meanwhile."""

ENOUGH = 4
"""Batches per worker that keep all workers busy to the end."""


class Evaluated(NamedTuple):
    """Where the evaluation of a policy is.

    Attributes:
        units: that hold it.
        policy_hash: of the policy that was evaluated.
        cells: that there are records of, by name.
    """

    units: tuple[str, ...]
    policy_hash: str
    cells: frozenset[str]

    @property
    def files(self) -> tuple[str, ...]:
        """The records, relative to the run's directory."""
        return tuple(f"evidence/{unit}.parquet" for unit in self.units)


class Played(NamedTuple):
    """Records that workers made.

    Attributes:
        start: Unix time when the first was begun, s.
        seconds: of workers' time that they took; None: all since the start.
        tables: of them.
    """

    start: float
    seconds: float | None
    tables: Iterable[Any]


def evaluated(
    directory: RunDirectory, *, lost: bool = False, first: int | None = None
) -> dict[str, Evaluated]:
    """The evaluations that are there, by policy.

    Args:
        directory: of the run.
        lost: also those of units whose records are gone.
        first: only those whose episodes begin with this one.
    """
    found: dict[str, Evaluated] = {}
    for unit, marker in directory.markers(PREFIX).items():
        other = first is not None and first_of(marker) != first
        if other or not (lost or directory.has_records(unit)):
            continue
        for policy, policy_hash in marker["policies"].items():
            before = found.get(policy, Evaluated((), policy_hash, frozenset()))
            cells = before.cells.union(marker["cells"].get(policy, ()))
            found[policy] = Evaluated((*before.units, unit), policy_hash, cells)
    return found


def discard_damaged(spec: PanelSpec, directory: RunDirectory, subjects: Sequence[Subject]) -> None:
    """Remove what killed or damaged units left of evaluations from the starts that came last.

    Raises:
        RunDirectoryError: if one was evaluated under another specification, version or hash.
    """
    hashes = _hashes(subjects)
    cells = {cell.name: cell for subject in subjects for cell in subject.cells}
    for unit, marker in directory.markers(PREFIX).items():
        if first_of(marker) != spec.latest.start:
            continue
        held_by = {policy: hashes.get(policy, held) for policy, held in marker["policies"].items()}
        names = dict.fromkeys(name for own in marker["cells"].values() for name in own)
        places = [cells[name] for name in names if name in cells]
        if directory.finished(unit, _key(spec, held_by, places)) is None:
            directory.discard_remains(unit)
    directory.discard_unmarked(PREFIX)


def not_evaluated(
    spec: PanelSpec, directory: RunDirectory, subjects: Sequence[Subject]
) -> list[Subject]:
    """Subjects with cells that are not evaluated from the starts that came last.

    Each knows how it did in the others, and at home from earlier starts.
    """
    hashes = _hashes(subjects)
    done = evaluated(directory, first=spec.latest.start)
    cells_of = {policy: done[policy].cells if policy in done else frozenset() for policy in hashes}
    waiting = {
        policy: subject
        for policy, subject in zip(hashes, subjects, strict=True)
        if not cells_of[policy].issuperset(cell.name for cell in subject.cells)
    }
    store = EvidenceStore(directory.evidence)
    if not waiting or not store.files():
        return [*waiting.values()]
    rows = store.query(_OUTCOMES.format(spec.latest.start, spec.latest.stop)).to_pylist()
    found = {(row["policy_id"], row["cell"]): row for row in rows}

    def knowing(policy: str, subject: Subject) -> Subject:
        homes = {d: found.get((policy, spec.name_of(d))) for d in subject.trained_on}
        earlier = {d: (row["succeeded"], row["episodes"]) for d, row in homes.items() if row}
        own = {cell: np.array(found[policy, cell]["latest"]) for cell in cells_of[policy]}
        return replace(subject, at_home=earlier, recorded=own)

    return [knowing(*each) for each in waiting.items()]


_OUTCOMES = """
SELECT policy_id, cell, count(*) FILTER (success AND episode_index < {0}) AS succeeded,
    count(*) FILTER (episode_index < {0}) AS episodes,
    list(success ORDER BY episode_index) FILTER (episode_index >= {0}) AS latest
FROM records WHERE phase = 'evaluation' AND episode_index < {1} GROUP BY ALL
"""


def next_cells(spec: PanelSpec, subjects: Sequence[Subject]) -> list[Subject]:
    """Subjects with the cells that come next: all, where lanes are advanced at once.

    Else those whose labels rest on no other that is missing, so that workers can share them. What
    is some policy's home comes early for all, so that policies are in the same cells together.
    """
    if spec.testbed.batched:
        return [*subjects]
    homes = {home for subject in subjects for home in subject.trained_on}
    chosen = []
    for subject in subjects:
        first = min(depth(cell, homes) for cell in subject.missing)
        early = (cell for cell in subject.missing if depth(cell, homes) == first)
        chosen.append(subject.among(cell.name for cell in early if subject.can_label(cell)))
    return chosen


def rounds_of(spec: PanelSpec, batch: Sequence[Subject]) -> list[tuple[Subject, ...]]:
    """A batch with what is evaluated before each commit, the longest cells first."""
    if spec.testbed.batched:
        return [tuple(batch)]
    rounds: list[list[str]] = []
    left = 0.0
    for name, policies in _by_cell(spec, batch).items():
        seconds = evaluation_seconds(spec, policies)
        if seconds > left:
            rounds.append([])
            left = ROUND
        rounds[-1].append(name)
        left -= seconds
    return [_among(batch, names) for names in rounds]


def _by_cell(spec: PanelSpec, batch: Sequence[Subject]) -> dict[str, tuple[Subject, ...]]:
    """Who is evaluated in each cell, that which takes longest first, by its name."""
    names = dict.fromkeys(cell.name for subject in batch for cell in subject.missing)
    found = {name: _among(batch, [name]) for name in names}
    order = sorted(names, key=lambda name: -evaluation_seconds(spec, found[name]))
    return {name: found[name] for name in order}


def _among(batch: Sequence[Subject], names: Sequence[str]) -> tuple[Subject, ...]:
    """Those of a batch that have some of these cells, in these."""
    chosen = (subject.among(names) for subject in batch)
    return tuple(subject for subject in chosen if subject.missing)


def batches_of(
    spec: PanelSpec, subjects: Sequence[Subject], workers: int
) -> list[tuple[Subject, ...]]:
    """Divide subjects into batches of one size; where lanes are advanced at once, for all workers.

    Those of one home stay together as far as that goes. Where lanes are advanced at once, a batch
    has records of the same cells.
    """
    alike: dict[frozenset[str], list[Subject]] = {}
    for subject in subjects:
        recorded = frozenset(subject.recorded if spec.testbed.batched else ())
        alike.setdefault(recorded, []).append(subject)
    return [batch for own in alike.values() for batch in _batches(spec, own, workers)]


def _batches(
    spec: PanelSpec, subjects: Sequence[Subject], workers: int
) -> list[tuple[Subject, ...]]:
    count = math.ceil(len(subjects) / _batch_size(spec, subjects))
    if spec.testbed.batched:
        count = min(len(subjects), workers * math.ceil(count / workers))
    homes = [subject.home for subject in subjects]
    order = sorted(range(len(subjects)), key=lambda place: homes.index(homes[place]))
    return [tuple(subjects[place] for place in part) for part in np.array_split(order, count)]


def evaluate_all(
    spec: PanelSpec,
    directory: RunDirectory,
    subjects: Sequence[Subject],
    label: str,
    cluster: Cluster,
    progress: bool,
) -> None:
    """Evaluate all subjects that have not been, each unit finished by one commit.

    No bar is shown where there is nothing to be done.

    Args:
        spec: the panel.
        directory: held by the caller.
        subjects: the policies.
        label: of the bar.
        cluster: where.
        progress: show a bar with the remaining time.
    """
    for part in spec.parts():
        discard_damaged(part, directory, subjects)
    waiting = [(part, not_evaluated(part, directory, subjects)) for part in spec.parts()]
    directory.storage.send()  # what is no longer there
    homes = [subject.home for subject in subjects]
    before = not_tried(spec, directory) or not_compared(spec, directory, homes)
    if not any(own for _, own in waiting) and not before:
        return
    seconds = all_seconds(spec, subjects)
    left = sum(evaluation_seconds(*own) for own in waiting)
    left += sum(trying_seconds(*own) for own in not_tried(spec, directory))
    bar = WorkBar(label, seconds, progress)
    with open_work(directory, cluster, bar, preparation_of(spec, cluster)) as work:
        work.progress.begin_at(seconds - left)
        compare_engines(spec, directory, homes, work)
        try_cells(spec, directory, work)
        for part in spec.parts():
            while own := not_evaluated(part, directory, subjects):
                _evaluate_part(part, directory, next_cells(part, own), work, cluster.workers)


def _evaluate_part(
    spec: PanelSpec,
    directory: RunDirectory,
    waiting: Sequence[Subject],
    work: Work,
    workers: int,
) -> None:
    """Evaluate subjects from the starts that came last, each unit finished by one commit."""
    batches = batches_of(spec, waiting, max(1, workers))
    rounds = [part for batch in batches for part in rounds_of(spec, batch)]
    can, contracts = statuses(spec, directory), contracts_in(directory)
    if workers < 2 or spec.testbed.batched or len(batches) >= ENOUGH * workers:
        units = {unit_of(spec, batch)[0]: (spec, batch, can, contracts) for batch in rounds}
        work.commit("evaluating", evaluate_batch, units)
        return
    rounds.sort(key=lambda batch: -_longest(spec, batch))
    tasks = tasks_of(spec, rounds, workers)
    place_of = {name: place for place, own in enumerate(tasks) for name in own}
    given = EvidenceStore(directory.evidence), can, None, contracts
    arguments = {name: (spec, *task, *given) for own in tasks for name, task in own.items()}
    found: dict[str, Played] = {}
    for name, played in work.each("evaluating", _evaluate_whole, arguments):
        found[name] = played
        place = place_of[name]
        if found.keys() >= tasks[place].keys():
            parts = [found.pop(task) for task in tasks[place]]
            evaluate_batch(spec, directory, rounds[place], can, contracts, _join(parts))
            directory.storage.send()
            del parts, played
            release_memory()


def _longest(spec: PanelSpec, batch: Sequence[Subject]) -> float:
    """Time of the cell of a batch that takes longest, s."""
    return evaluation_seconds(spec, next(iter(_by_cell(spec, batch).values())))


def tasks_of(
    spec: PanelSpec, rounds: Sequence[Sequence[Subject]], workers: int
) -> list[dict[str, tuple[tuple[Subject, ...], range]]]:
    """Tasks of each round, by name: policies in one cell, and which of their episodes.

    The episodes of a cell are divided if their rows take much memory. They are divided among all
    workers if cells are few, and in the last cells, so that no worker waits long.
    """
    cells = [_by_cell(spec, batch) for batch in rounds]
    seconds = [evaluation_seconds(spec, own) for by_cell in cells for own in by_cell.values()]
    few, left = sum(seconds) < 2 * workers * max(seconds), len(seconds)
    tasks: list[dict[str, tuple[tuple[Subject, ...], range]]] = []
    for by_cell in cells:
        tasks.append({})
        for name, batch in by_cell.items():
            (cell,) = (cell for cell in batch[0].missing if cell.name == name)
            parts = math.ceil(len(batch) * len(spec.latest) * _bytes(spec, cell) / HANDED_OVER)
            if few or left <= workers:
                parts = workers * math.ceil(parts / workers)
            for part in divided(spec, parts):
                said = f"{', '.join(_hashes(batch))} in {name} from episode {part.start}"
                tasks[-1][said] = batch, part
            left -= 1
    return tasks


def _join(parts: Sequence[Played]) -> Played:
    """All tables one after the other, with the time that they took together."""
    start = min(time.time(), *(part.start for part in parts))
    tables = (table for part in parts for table in part.tables)
    return Played(start, sum(part.seconds or 0.0 for part in parts), tables)


def evaluate_batch(
    spec: PanelSpec,
    directory: RunDirectory,
    batch: Sequence[Subject],
    can: Mapping[str, str],
    contracts: Contracts,
    played: Played | None = None,
) -> None:
    """Evaluate policies in all their cells here, unless that was done elsewhere, and mark it as
    finished.

    Args:
        spec: the panel.
        directory: that it is written to.
        batch: the policies.
        can: whether a cell can be solved, by its name.
        contracts: what was compared of homes and cells on other engines.
        played: the records, where they were made elsewhere.
    """
    hashes = _hashes(batch)
    unit, key = unit_of(spec, batch)
    store = EvidenceStore(directory.evidence)
    directory.discard_remains(unit)
    if played is None:
        tables = evaluate(spec, batch, spec.latest, store, can, contracts=contracts)
        played = Played(time.time(), None, tables)
    store.commit_all(unit, played.tables)
    names = {s.policy.policy_id: [cell.name for cell in s.missing] for s in batch}
    facts = {"first": spec.latest.start, "policies": hashes, "cells": names}
    directory.finish(unit, key, played.start, played.seconds, **facts)


def evaluation_seconds(spec: PanelSpec, subjects: Sequence[Subject]) -> float:
    """Time that the evaluation of subjects from the starts that came last takes one worker, s."""
    share = len(spec.latest) / spec.episodes
    return share * sum(cell_seconds(spec, cell) for own in subjects for cell in own.missing)


def all_seconds(spec: PanelSpec, subjects: Sequence[Subject]) -> float:
    """Time that one worker takes to try all cells, and to evaluate from all starts, s."""
    cells = [trying_seconds(part, cell) for part in spec.parts() for cell in part.columns()]
    return sum(cells) + sum(evaluation_seconds(part, subjects) for part in spec.parts())


def _evaluate_whole(*given: Any) -> Played:
    release_memory()  # of tables that were handed over before
    start = time.time()
    tables = list(evaluate(*given))
    return Played(start, time.time() - start, tables)


def unit_of(spec: PanelSpec, batch: Sequence[Subject]) -> tuple[str, str]:
    """Name of the unit that evaluates a batch, and hash of its inputs.

    The latter tells units of one policy apart, of which there are several where it is evaluated in
    rounds or got cells later.
    """
    hashes = _hashes(batch)
    cells = {cell.name: cell for subject in batch for cell in subject.missing}
    key = _key(spec, hashes, cells.values())
    first, others = next(iter(hashes)), len(hashes) - 1
    named = f"{first}-and-{others}-more" if others else first
    unit = f"{PREFIX}{named}{name_start(spec.latest.start)}"
    is_one = spec.testbed.batched and not batch[0].recorded
    return (unit if is_one else f"{unit}-added-{key[:8]}"), key


def statuses(spec: PanelSpec, directory: RunDirectory) -> dict[str, str]:
    """Whether each cell that was tried can be solved, by its name."""
    found = tried(directory, spec.episodes)
    return {cell: own.achieved().status for cell, own in found.items() if own != Tried()}


def _hashes(subjects: Sequence[Subject]) -> dict[str, str]:
    return {subject.policy.policy_id: subject.policy.content_hash for subject in subjects}


def _key(spec: PanelSpec, hashes: Mapping[str, str], cells: Iterable[Cell]) -> str:
    where = list(cells)
    engines = engine_versions({cell.discretization.engine for cell in where})
    return key_of(engines, spec=inputs(spec, where), policies=hashes)


def _batch_size(spec: PanelSpec, subjects: Sequence[Subject]) -> int:
    """How many policies fit a batch: one where lanes do not act together."""
    if not (spec.testbed.batched or getattr(spec.testbed, "together", False)):
        return 1
    cells = {cell.name: cell for subject in subjects for cell in subject.missing}
    most_bytes = COPIES * len(spec.latest) * max(_bytes(spec, cell) for cell in cells.values())
    if not spec.testbed.batched:
        return max(1, int(MEMORY / most_bytes))
    times = {name: cell_seconds(spec, cell) for name, cell in cells.items()}
    whole = max(sum(times[cell.name] for cell in subject.missing) for subject in subjects)
    seconds = whole * len(spec.latest) / spec.episodes
    return max(1, int(min(LONGEST / seconds, MEMORY / most_bytes)))


def _bytes(spec: PanelSpec, cell: Cell) -> int:
    """Size of the rows of one episode in a cell."""
    columns = len(Layout(spec.nominal.plant, spec.nominal.task))
    return 8 * columns * (cell_timing(spec, cell).horizon + 1)
