"""A finished run held against its own plan: units, policies, records, and what is told of them."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from integ_gym.evidence import EvidenceStore, Finding, broken_seals, recompute, replay
from integ_gym.train import POLICY_FILE, WEIGHTS_FILE, read_trained, read_weights

from .existing import hashes_of
from .model import FILE_NAME, read_panel
from .running import (
    MANIFEST,
    Evaluated,
    RunDirectory,
    RunDirectoryError,
    evaluated,
    is_card_of,
    read_manifest,
)

_EVALUATED = """
SELECT policy_id, cell, count(DISTINCT episode_index) AS present, min(episode_index) AS first,
       max(episode_index) AS last, count(*) AS records
FROM records WHERE phase = 'evaluation' GROUP BY ALL ORDER BY policy_id, cell
"""

_WHOSE = """
SELECT run_id, phase, policy_id, policy_hash, count(*) AS records
FROM records GROUP BY ALL ORDER BY run_id, policy_id
"""


_LABELS = """
SELECT policy_id, cell, failure_label, count(*) AS records
FROM records WHERE phase = 'evaluation' GROUP BY ALL
"""

_SUCCESS, _EVALUATION = "none", "evaluate-"

SAMPLED_FILES, SAMPLED_RECORDS = 2, 64
"""Files, and records of each, that are recomputed and played again before a page is written."""


def check_finished(path: Path) -> None:
    """Refuse a run whose files are not those that it was finished and sealed with.

    Raises:
        RunDirectoryError: with the first of them and the remedy.
    """
    _refuse_first(path, against_plan(path), broken_seals(path), _of_sample(_directory(path)))


def check_records(directory: RunDirectory) -> None:
    """Refuse records that no unit was finished with, or whose outcomes their traces deny.

    Of the latter a sample is recomputed and played again; `integ-gym evidence verify --all` does
    that with all.

    Raises:
        RunDirectoryError: with the first of them and the remedy.
    """
    _refuse_first(directory.path, _of_files(directory), _of_sample(directory))


def _refuse_first(path: Path, *findings: Iterator[Finding]) -> None:
    for finding in chain.from_iterable(findings):
        raise RunDirectoryError(
            f"{path / finding.file}: {finding.message}; restore it from a copy, or remove it and "
            "run the panel's command again, which does what is missing"
        )


def against_plan(path: Path) -> Iterator[Finding]:
    """What of a run is not as it was planned; nothing for a directory that no panel was run in.

    Args:
        path: the run's directory.
    """
    directory = _directory(path)
    if not (path / MANIFEST).exists():
        if (path / FILE_NAME).exists() or directory.markers(""):
            yield Finding(MANIFEST, None, "is missing, which says what was planned")
        return
    yield from _of_files(directory)
    found = evaluated(directory, lost=True)
    yield from _of_policies(directory, found)
    planned = read_manifest(path / MANIFEST)["specification"]
    yield from _of_records(directory, found, planned)
    yield from _of_matrix(directory)


def _directory(path: Path) -> RunDirectory:
    return RunDirectory(path, {})


def _of_files(directory: RunDirectory) -> Iterator[Finding]:
    for file, fault in directory.faults():
        yield Finding(file, None, fault)


def _of_policies(directory: RunDirectory, found: Mapping[str, Evaluated]) -> Iterator[Finding]:
    """Policies that are not those that were trained or evaluated."""
    trained = {
        unit.removeprefix("train-"): held for unit, held in directory.markers("train-").items()
    }
    for policy in {**found, **trained}:
        folder, name = directory.policies / policy, f"policies/{policy}"
        if policy in trained and not (folder / POLICY_FILE).exists():
            yield Finding(name, None, "is missing")
            continue
        try:
            same = (
                _is_trained(folder, trained[policy])
                if policy in trained
                else _is_given(folder, found[policy].policy_hash)
            )
        except ValueError as error:
            yield Finding(name, None, str(error))
            continue
        if not same:
            yield Finding(name, None, "is not the policy that this run was made with")


def _is_trained(folder: Path, marker: Mapping[str, Any]) -> bool:
    """Whether policy, side-car and copy of the weights are what a training unit ended with."""
    _, card = read_trained(folder / POLICY_FILE)
    copy = folder / WEIGHTS_FILE
    same = not copy.exists() or read_weights(copy).content_hash == card["content_hash"]
    return same and is_card_of(card, marker)


def _is_given(folder: Path, expected: str) -> bool:
    """Whether a policy that was evaluated, if it came as a file, has the expected hash."""
    hashes = hashes_of(folder)
    return not hashes or expected in hashes


def _of_records(
    directory: RunDirectory, found: Mapping[str, Evaluated], planned: Mapping[str, Any]
) -> Iterator[Finding]:
    """Records of other runs or policies, and cells without all their episodes."""
    store = EvidenceStore(directory.evidence)
    for row in store.query(_WHOSE).to_pylist():
        policy, whose = row["policy_id"], f"{row['records']} records of policy {row['policy_id']!r}"
        if row["run_id"] != planned.get("name"):
            yield Finding("evidence", None, f"{whose} are of run {row['run_id']!r}")
        elif row["phase"] == "evaluation" and policy not in found:
            yield Finding("evidence", None, f"{whose}, which no unit evaluated")
        elif row["phase"] == "evaluation" and row["policy_hash"] != found[policy].policy_hash:
            yield Finding("evidence", None, f"{whose} are of another policy of that name")
    cells: dict[str, dict[str, tuple[int, int, int]]] = {}
    for row in store.query(_EVALUATED).to_pylist():
        episodes = row["present"], row["first"], row["last"]
        if row["records"] > row["present"]:
            have = f"{row['records']} records of {row['present']} episodes in cell {row['cell']!r}"
            yield Finding("evidence", None, f"policy {row['policy_id']!r} has {have}")
        cells.setdefault(row["policy_id"], {})[row["cell"]] = episodes
    expected = {policy: there.cells for policy, there in found.items()}
    yield from _of_cells(cells, expected, planned.get("episodes"))


def _of_cells(
    cells: Mapping[str, Mapping[str, tuple[int, int, int]]],
    expected: Mapping[str, frozenset[str]],
    episodes: Any,
) -> Iterator[Finding]:
    for policy, names in expected.items():
        own = cells.get(policy, {})
        if not own:
            yield Finding("evidence", None, f"policy {policy!r} has no evaluation records")
            continue
        for cell in sorted(names | set(own)):
            found = own.get(cell, (0, 0, -1))
            if found != (episodes, 0, episodes - 1):
                have = f"has {found[0]} of {episodes} episodes in cell {cell!r}"
                yield Finding("evidence", None, f"policy {policy!r} {have}")


def _of_matrix(directory: RunDirectory) -> Iterator[Finding]:
    """Entries of ``panel.json`` that the records deny."""
    file = directory.path / FILE_NAME
    if not file.exists():
        return
    try:
        panel = read_panel(file)
    except ValueError as error:
        yield Finding(FILE_NAME, None, str(error))
        return
    found: dict[tuple[str, str], Counter[str]] = {}
    for row in EvidenceStore(directory.evidence).query(_LABELS).to_pylist():
        own = found.setdefault((row["policy_id"], row["cell"]), Counter())
        own[row["failure_label"]] += row["records"]
    policies = {row.name: [policy.id for policy in row.policies] for row in panel.rows}
    for entry in panel.matrix:
        each = [found.get((name, entry.cell), Counter()) for name in policies[entry.row]]
        rates = [own[_SUCCESS] / max(1, own.total()) for own in each]
        records = sum(each, Counter())
        told = (entry.episodes, dict(entry.labels), tuple(entry.success_by_seed))
        if not _alike(told, (records.total(), dict(records), tuple(rates))):
            yield Finding(
                FILE_NAME,
                None,
                f"what it says of {entry.row!r} in cell {entry.cell!r} is not what the records say",
            )


def _alike(told: tuple[Any, ...], found: tuple[Any, ...]) -> bool:
    """Whether counts are the same, and rates to rounding."""
    *counts, rates = told
    *others, again = found
    return counts == others and len(rates) == len(again) and bool(np.allclose(rates, again))


def _of_sample(directory: RunDirectory) -> Iterator[Finding]:
    """Outcomes that their traces deny, and traces that their environments deny.

    Looked at are evaluation records that nobody can foretell.
    """
    store = EvidenceStore(directory.evidence)
    files = [file.name for file in store.files() if file.name.startswith(_EVALUATION)]
    for name in random.sample(files, min(len(files), SAMPLED_FILES)):
        records = store.some_records(name, SAMPLED_RECORDS)
        for record in records:
            yield from recompute(record, f"evidence/{name}")
        yield from replay([(f"evidence/{name}", record) for record in records]).findings
