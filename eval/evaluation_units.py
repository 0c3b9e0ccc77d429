"""Evaluation as units of work: batches of policies, each finished by one atomic commit.

Which policies share a batch depends on cores and memory. A batch's marker lists its policies with
their hashes, so that another division goes on where an interrupted one ended.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from integ_gym.envs.registration import environment_setup
from integ_gym.eval.cells import Cell
from integ_gym.eval.evaluation import (
    Conditions,
    OnCell,
    Subject,
    conditions_of,
    evaluate,
    quiet,
)
from integ_gym.eval.expected_time import cell_seconds, cell_timing
from integ_gym.eval.run_directory import RunDirectory, key_of
from integ_gym.eval.spec import PanelSpec
from integ_gym.evidence.layout import Layout
from integ_gym.evidence.store import EvidenceStore

PREFIX = "evaluate-"

LONGEST = 60.0
"""What a batch should take at most, s."""

MEMORY = 1 << 30
"""What the episodes of a batch may take, bytes."""

COPIES = 6
"""How often a cell's rows are in memory: as they come, by episode, as a table, as a row group."""


Evaluation: TypeAlias = Callable[[Sequence[Subject], Conditions, EvidenceStore, str, OnCell], None]
"""See :func:`integ_gym.eval.evaluation.evaluate`."""


class Evaluated(NamedTuple):
    """Where the evaluation of a policy is.

    Attributes:
        unit: that holds it.
        policy_hash: of the policy that was evaluated.
    """

    unit: str
    policy_hash: str

    @property
    def file(self) -> str:
        """The records, relative to the run's directory."""
        return f"evidence/{self.unit}.parquet"


def evaluated(directory: RunDirectory) -> dict[str, Evaluated]:
    """The evaluations that are there, by policy."""
    return {
        policy: Evaluated(unit, policy_hash)
        for unit, marker in directory.markers(PREFIX).items()
        if directory.has_records(unit)
        for policy, policy_hash in marker["policies"].items()
    }


def not_evaluated(
    spec: PanelSpec, directory: RunDirectory, subjects: Sequence[Subject]
) -> list[Subject]:
    """Subjects without an evaluation; what killed or damaged units left is removed.

    Raises:
        RunDirectoryError: if one was evaluated under another specification, version or hash.
    """
    hashes = _hashes(subjects)
    for unit, marker in directory.markers(PREFIX).items():
        own = {policy: hashes.get(policy, "") for policy in marker["policies"]}
        if directory.finished(unit, _key(spec, own)) is None:
            directory.discard_remains(unit)
    directory.discard_unmarked(PREFIX)
    done = evaluated(directory)
    return [subject for subject in subjects if subject.policy.policy_id not in done]


def batches_of(
    spec: PanelSpec, subjects: Sequence[Subject], workers: int
) -> list[tuple[Subject, ...]]:
    """Divide subjects into batches of one size, some for every worker.

    Those of one home stay together as far as that goes.
    """
    if not subjects:
        return []
    fewest = math.ceil(len(subjects) / _fitting(spec, subjects))
    count = min(len(subjects), workers * math.ceil(fewest / workers))
    homes = [subject.home for subject in subjects]
    order = sorted(range(len(subjects)), key=lambda place: homes.index(homes[place]))
    return [tuple(subjects[place] for place in part) for part in np.array_split(order, count)]


def evaluate_batch(
    spec: PanelSpec,
    directory: RunDirectory,
    batch: Sequence[Subject],
    on_cell: OnCell = quiet,
    run: Evaluation = evaluate,
) -> None:
    """Evaluate policies in all their cells and mark that as finished.

    Args:
        spec: the panel.
        directory: held by the caller.
        batch: the policies.
        on_cell: told after every cell which it was and how many policies were in it.
        run: what evaluates them.
    """
    hashes = _hashes(batch)
    first, others = next(iter(hashes)), len(hashes) - 1
    unit = f"{PREFIX}{first}-and-{others}-more" if others else f"{PREFIX}{first}"
    start = time.time()
    run(batch, conditions_of(spec), EvidenceStore(directory.evidence), unit, on_cell)
    directory.finish(unit, _key(spec, hashes), start, policies=hashes)


def _hashes(subjects: Sequence[Subject]) -> dict[str, str]:
    return {subject.policy.policy_id: subject.policy.content_hash for subject in subjects}


def _key(spec: PanelSpec, hashes: Mapping[str, str]) -> str:
    return key_of(spec.engine_versions(), spec=spec.to_json(), policies=hashes)


def _fitting(spec: PanelSpec, subjects: Sequence[Subject]) -> int:
    """How many policies fit a batch."""
    cells = {cell.name: cell for subject in subjects for cell in subject.cells}
    times = {name: cell_seconds(spec, cell) for name, cell in cells.items()}
    seconds = max(sum(times[cell.name] for cell in subject.cells) for subject in subjects)
    most_bytes = COPIES * spec.episodes * max(_bytes(spec, cell) for cell in cells.values())
    return max(1, int(min(LONGEST / seconds, MEMORY / most_bytes)))


def _bytes(spec: PanelSpec, cell: Cell) -> int:
    """Size of the rows of one episode in a cell."""
    truth = environment_setup(spec.env_id, spec.columns()[-1].arguments(spec.environment))
    columns = len(Layout(truth.plant, truth.task))
    return 8 * columns * (cell_timing(spec, cell).horizon + 1)
