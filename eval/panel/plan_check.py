"""A finished run held against its own plan: units, policies, and how many records of what."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from integ_gym.evidence import EvidenceStore, Finding
from integ_gym.train import POLICY_FILE, read_trained

from .existing import hashes_of
from .running import MANIFEST, RunDirectory, RunDirectoryError, is_card_of, read_manifest

_EVALUATED = """
SELECT policy_id, cell, count(DISTINCT episode_index) AS present, min(episode_index) AS first,
       max(episode_index) AS last
FROM records WHERE phase = 'evaluation' GROUP BY ALL ORDER BY policy_id, cell
"""

_WHOSE = """
SELECT run_id, phase, policy_id, policy_hash, count(*) AS records
FROM records GROUP BY ALL ORDER BY run_id, policy_id
"""


def check_finished(path: Path) -> None:
    """Refuse a run whose files are not those that its units were finished with.

    Raises:
        RunDirectoryError: with the first of them and the remedy.
    """
    for finding in (*_of_files(_directory(path)), *_of_policies(_directory(path))):
        raise RunDirectoryError(
            f"{path / finding.file}: {finding.message}; restore it from a copy, or remove it and "
            "run the panel's command again, which does what is missing"
        )


def against_plan(path: Path) -> Iterator[Finding]:
    """What of a run is not as it was planned; nothing for a directory without a plan.

    Args:
        path: the run's directory.
    """
    if not (path / MANIFEST).exists():
        return
    directory = _directory(path)
    yield from _of_files(directory)
    yield from _of_policies(directory)
    planned = read_manifest(path / MANIFEST)["specification"]
    yield from _of_records(directory, planned)


def _directory(path: Path) -> RunDirectory:
    return RunDirectory(path, {})


def _of_files(directory: RunDirectory) -> Iterator[Finding]:
    for file, fault in directory.faults():
        yield Finding(file, None, fault)


def _of_policies(directory: RunDirectory) -> Iterator[Finding]:
    """Policies that are not those that were trained or evaluated."""
    evaluated = _evaluated(directory)
    trained = {
        unit.removeprefix("train-"): held for unit, held in directory.markers("train-").items()
    }
    for policy in {**evaluated, **trained}:
        folder, name = directory.policies / policy, f"policies/{policy}"
        if policy in trained and not (folder / POLICY_FILE).exists():
            yield Finding(name, None, "is missing")
            continue
        try:
            same = (
                _is_trained(folder, trained[policy])
                if policy in trained
                else _is_given(folder, evaluated[policy])
            )
        except ValueError as error:
            yield Finding(name, None, str(error))
            continue
        if not same:
            yield Finding(name, None, "is not the policy that this run was made with")


def _is_trained(folder: Path, marker: Mapping[str, Any]) -> bool:
    """Whether policy and side-car are those that a training unit ended with."""
    _, card = read_trained(folder / POLICY_FILE)
    return is_card_of(card, marker)


def _is_given(folder: Path, expected: str) -> bool:
    """Whether a policy that was evaluated, if it came as a file, has the expected hash."""
    hashes = hashes_of(folder)
    return not hashes or expected in hashes


def _evaluated(directory: RunDirectory) -> dict[str, str]:
    """Policy to the hash that it was evaluated with."""
    return {
        policy: policy_hash
        for held in directory.markers("evaluate-").values()
        for policy, policy_hash in held["policies"].items()
    }


def _of_records(directory: RunDirectory, planned: Mapping[str, Any]) -> Iterator[Finding]:
    """Records of other runs or policies, and cells without all their episodes."""
    store, evaluated = EvidenceStore(directory.evidence), _evaluated(directory)
    for row in store.query(_WHOSE).to_pylist():
        policy, whose = row["policy_id"], f"{row['records']} records of policy {row['policy_id']!r}"
        if row["run_id"] != planned.get("name"):
            yield Finding("evidence", None, f"{whose} are of run {row['run_id']!r}")
        elif row["phase"] == "evaluation" and policy not in evaluated:
            yield Finding("evidence", None, f"{whose}, which no unit evaluated")
        elif row["phase"] == "evaluation" and row["policy_hash"] != evaluated[policy]:
            yield Finding("evidence", None, f"{whose} are of another policy of that name")
    cells: dict[str, dict[str, tuple[int, int, int]]] = {}
    for row in store.query(_EVALUATED).to_pylist():
        found = row["present"], row["first"], row["last"]
        cells.setdefault(row["policy_id"], {})[row["cell"]] = found
    yield from _of_cells(cells, list(evaluated), planned.get("episodes"))


def _of_cells(
    cells: Mapping[str, Mapping[str, tuple[int, int, int]]], policies: list[str], episodes: Any
) -> Iterator[Finding]:
    rows: dict[str, set[str]] = {}
    for policy, own in cells.items():
        rows.setdefault(_row(policy), set()).update(own)
    for policy in policies:
        own = cells.get(policy, {})
        if not own:
            yield Finding("evidence", None, f"policy {policy!r} has no evaluation records")
            continue
        for cell in sorted(rows[_row(policy)]):
            found = own.get(cell, (0, 0, -1))
            if found != (episodes, 0, episodes - 1):
                have = f"has {found[0]} of {episodes} episodes in cell {cell!r}"
                yield Finding("evidence", None, f"policy {policy!r} {have}")


def _row(policy: str) -> str:
    """The row of a policy: its name without its seed."""
    return policy.rpartition("-seed")[0] or policy
