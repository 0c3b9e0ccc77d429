"""Evaluation as units of work: batches of policies, each finished by one atomic commit.

Which policies share a batch depends on cores and memory. A batch's marker lists its policies with
their hashes, so that another division goes on where an interrupted one ended. A batch has the
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
from integ_gym.evidence.schema import pyarrow
from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.executors import Cluster
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

ROUND = 5.0
"""What a policy's cells should take at most between two commits where lanes are not all advanced at
once, s: an episode of a robot takes 1 to 3 MB."""

MEMORY = 1 << 30
"""What the episodes of a batch may take, bytes."""

COPIES = 8
"""How often a cell's rows are in memory: as they come, by episode, as a table, as a row group, and
twice as many while those that failed have twice the time."""


HANDED_OVER = 64e6
"""What the episodes that a worker hands over at once may take, bytes; it holds them several times
meanwhile."""

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

    Else those whose labels rest on none that is missing, so that workers can share them.
    """
    if spec.testbed.batched:
        return [*subjects]
    homes = {home for subject in subjects for home in subject.trained_on}
    depths = [{cell.name: depth(cell, homes) for cell in own.missing} for own in subjects]
    return [
        subject.among(name for name, depth in own.items() if depth == min(own.values()))
        for subject, own in zip(subjects, depths, strict=True)
    ]


def rounds_of(spec: PanelSpec, batch: Sequence[Subject]) -> list[tuple[Subject, ...]]:
    """A batch with what is evaluated before each commit, the longest cells first."""
    if spec.testbed.batched:
        return [tuple(batch)]
    rounds: list[list[str]] = []
    left = 0.0
    for cell in _longest_first(spec, batch):
        seconds = cell_seconds(spec, cell) * len(spec.latest) / spec.episodes
        if seconds > left:
            rounds.append([])
            left = ROUND
        rounds[-1].append(cell.name)
        left -= seconds
    return [tuple(subject.among(names) for subject in batch) for names in rounds]


def _longest_first(spec: PanelSpec, batch: Sequence[Subject]) -> list[Cell]:
    cells = {cell.name: cell for subject in batch for cell in subject.missing}
    return sorted(cells.values(), key=lambda cell: -cell_seconds(spec, cell))


def batches_of(
    spec: PanelSpec, subjects: Sequence[Subject], workers: int
) -> list[tuple[Subject, ...]]:
    """Divide subjects into batches of one size, some for every worker.

    Those of one home stay together as far as that goes; a batch has records of the same cells.
    """
    alike: dict[frozenset[str], list[Subject]] = {}
    for subject in subjects:
        alike.setdefault(frozenset(subject.recorded), []).append(subject)
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
    """Evaluate all subjects that have not been, each batch finished by one commit.

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
    """Evaluate subjects from the starts that came last, each batch finished by one commit."""
    batches = batches_of(spec, waiting, max(1, workers))
    rounds = [part for batch in batches for part in rounds_of(spec, batch)]
    can, contracts = statuses(spec, directory), contracts_in(directory)
    if workers < 2 or spec.testbed.batched or len(batches) >= ENOUGH * workers:
        units = {unit_of(spec, batch)[0]: (spec, batch, can, contracts) for batch in rounds}
        work.commit("evaluating", evaluate_batch, units)
        return
    tasks, rounds_by_task = tasks_of(spec, rounds, workers)
    given = EvidenceStore(directory.evidence), can, None, contracts
    found: dict[str, list[Any]] = {}
    arguments = {name: (spec, *task, *given) for name, task in tasks.items()}
    for name, tables in work.each("evaluating", _evaluate_whole, arguments):
        found[name] = tables
        own = [task for task, place in rounds_by_task.items() if place == rounds_by_task[name]]
        if found.keys() >= {*own}:
            played = (table for task in own for table in found.pop(task))
            batch = rounds[rounds_by_task[name]]
            evaluate_batch(spec, directory, batch, can, contracts, played)
            directory.storage.send()
            pyarrow().default_memory_pool().release_unused()


def tasks_of(
    spec: PanelSpec, rounds: Sequence[Sequence[Subject]], workers: int
) -> tuple[dict[str, tuple[tuple[Subject, ...], range]], dict[str, int]]:
    """Tasks, the longest first: policies in one cell and episodes of theirs, by name.

    Those of a cell are divided where there are many, and among all workers where there are few
    cells to go round, and at the end, so that none waits long.

    Returns:
        The tasks, and the place among ``rounds`` of that which each is of.
    """
    pieces = [
        (cell_seconds(spec, cell) * len(batch), place, cell)
        for place, batch in enumerate(rounds)
        for cell in _longest_first(spec, batch)
    ]
    pieces.sort(key=lambda piece: -piece[0])
    few = sum(seconds for seconds, _, _ in pieces) < 2 * workers * pieces[0][0]
    tasks, rounds_by_task = {}, {}
    for left, (_, place, cell) in zip(range(len(pieces), 0, -1), pieces, strict=True):
        batch = tuple(subject.among([cell.name]) for subject in rounds[place])
        parts = math.ceil(len(batch) * len(spec.latest) * _bytes(spec, cell) / HANDED_OVER)
        for part in divided(spec, max(parts, workers if few or left <= workers else 1)):
            name = f"{', '.join(_hashes(batch))} in {cell.name} from episode {part.start}"
            tasks[name], rounds_by_task[name] = (batch, part), place
    return tasks, rounds_by_task


def evaluate_batch(
    spec: PanelSpec,
    directory: RunDirectory,
    batch: Sequence[Subject],
    can: Mapping[str, str],
    contracts: Contracts,
    tables: Iterable[Any] | None = None,
) -> None:
    """Evaluate policies in all their cells, by default here, and mark that as finished.

    Args:
        spec: the panel.
        directory: that it is written to.
        batch: the policies, with records of the same cells.
        can: whether a cell can be solved, by its name.
        contracts: what was compared of homes and cells on other engines.
        tables: the records, where they were made elsewhere.
    """
    hashes, start = _hashes(batch), time.time()
    unit, key = unit_of(spec, batch)
    store = EvidenceStore(directory.evidence)
    directory.discard_remains(unit)
    played = tables or evaluate(spec, batch, spec.latest, store, can, contracts=contracts)
    store.commit_all(unit, played)
    names = {s.policy.policy_id: [cell.name for cell in s.missing] for s in batch}
    directory.finish(unit, key, start, first=spec.latest.start, policies=hashes, cells=names)


def evaluation_seconds(spec: PanelSpec, subjects: Sequence[Subject]) -> float:
    """Time that the evaluation of subjects from the starts that came last takes one worker, s."""
    share = len(spec.latest) / spec.episodes
    return share * sum(cell_seconds(spec, cell) for own in subjects for cell in own.missing)


def all_seconds(spec: PanelSpec, subjects: Sequence[Subject]) -> float:
    """Time that one worker takes to try all cells, and to evaluate from all starts, s."""
    cells = [trying_seconds(part, cell) for part in spec.parts() for cell in part.columns()]
    return sum(cells) + sum(evaluation_seconds(part, subjects) for part in spec.parts())


def _evaluate_whole(*given: Any) -> list[Any]:
    pyarrow().default_memory_pool().release_unused()  # of tables that were handed over before
    return list(evaluate(*given))


def unit_of(spec: PanelSpec, batch: Sequence[Subject]) -> tuple[str, str]:
    """Name of the unit that evaluates a batch, and hash of its inputs."""
    hashes = _hashes(batch)
    cells = {cell.name: cell for subject in batch for cell in subject.missing}
    key = _key(spec, hashes, cells.values())
    first, others = next(iter(hashes)), len(hashes) - 1
    named = f"{first}-and-{others}-more" if others else first
    unit = f"{PREFIX}{named}{name_start(spec.latest.start)}"
    return (f"{unit}-added-{key[:8]}" if batch[0].recorded else unit), key


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
    """How many policies fit a batch: one where each lane costs its own."""
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
