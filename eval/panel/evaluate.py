"""Evaluation as units of work: batches of policies, each finished by one atomic commit.

Which policies share a batch depends on cores and memory. A batch's marker lists its policies with
their hashes, so that another division goes on where an interrupted one ended. A batch has the
starts that came at a time (:meth:`PanelSpec.parts`): where a panel is meant, its last part is.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from integ_gym.envs.engines.stepping import engine_versions
from integ_gym.evidence.episodes import Layout
from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.executors import Cluster
from integ_gym.support.terminal import WorkBar

from .achieve import Tried, not_tried, tried, try_cells
from .cells import Cell
from .contracts import Contracts, compare_engines, contracts_in, not_compared
from .costs import cell_seconds, cell_timing, trying_seconds
from .episodes import Subject, divided, evaluate, in_order
from .plan import inputs
from .run_directory import RunDirectory, first_of, key_of, name_start
from .spec import PanelSpec
from .training import preparation_of
from .units import Work, open_work

PREFIX = "evaluate-"

LONGEST = 60.0
"""What a batch should take at most, s."""

ROUND = 10.0
"""What a policy's cells should take at most between two commits where lanes are run one by one, s:
an episode of a robot takes 1 to 3 MB."""

MEMORY = 1 << 30
"""What the episodes of a batch may take, bytes."""

COPIES = 8
"""How often a cell's rows are in memory: as they come, by episode, as a table, as a row group, and
twice as many while those that failed have twice the time."""


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


def next_cells(spec: PanelSpec, subject: Subject) -> Subject:
    """A subject with what is evaluated before the next commit: all cells, where that is quick."""
    if spec.testbed.batched:
        return subject
    chosen: dict[str, float] = {}
    for cell in in_order(subject.missing, subject.trained_on):
        seconds = cell_seconds(spec, cell) * len(spec.latest) / spec.episodes
        if chosen and sum(chosen.values()) + seconds > ROUND:
            break
        chosen[cell.name] = seconds
    return subject.among(chosen)


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
    fewest = math.ceil(len(subjects) / _batch_size(spec, subjects))
    count = min(len(subjects), workers * math.ceil(fewest / workers))
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
                parts = [next_cells(part, subject) for subject in own]
                _evaluate_part(part, directory, parts, work, max(1, cluster.workers))


def _evaluate_part(
    spec: PanelSpec,
    directory: RunDirectory,
    waiting: Sequence[Subject],
    work: Work,
    workers: int,
) -> None:
    """Evaluate subjects from the starts that came last, each batch finished by one commit."""
    batches, can = batches_of(spec, waiting, workers), statuses(spec, directory)
    contracts = contracts_in(directory)
    if workers == 1 or spec.testbed.batched or len(batches) >= ENOUGH * workers:
        units = {unit_of(spec, batch)[0]: (spec, batch, can, contracts) for batch in batches}
        work.commit("evaluating", evaluate_batch, units)
        return

    def divide(batch: Sequence[Subject]) -> Iterator[Any]:
        """The tables of a batch whose episodes are divided among all workers."""
        given = EvidenceStore(directory.evidence), can, None, contracts
        parts = {
            f"{', '.join(_hashes(batch))} from episode {part.start}": (spec, batch, part, *given)
            for part in divided(spec, workers)
        }
        for tables in work.do("evaluating", _evaluate_whole, parts):
            yield from tables

    for batch in batches:
        evaluate_batch(spec, directory, batch, can, contracts, divide(batch))
        directory.storage.send()


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
    if not spec.testbed.batched:
        return 1
    cells = {cell.name: cell for subject in subjects for cell in subject.missing}
    times = {name: cell_seconds(spec, cell) for name, cell in cells.items()}
    whole = max(sum(times[cell.name] for cell in subject.missing) for subject in subjects)
    seconds = whole * len(spec.latest) / spec.episodes
    most_bytes = COPIES * len(spec.latest) * max(_bytes(spec, cell) for cell in cells.values())
    return max(1, int(min(LONGEST / seconds, MEMORY / most_bytes)))


def _bytes(spec: PanelSpec, cell: Cell) -> int:
    """Size of the rows of one episode in a cell."""
    columns = len(Layout(spec.nominal.plant, spec.nominal.task))
    return 8 * columns * (cell_timing(spec, cell).horizon + 1)
