"""``integ-gym evidence verify``: whole, sealed, replayed."""

from __future__ import annotations

import argparse
import contextlib
import random
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

from integ_gym.evidence import (
    ELSEWHERE,
    SCHEMA_VERSION,
    SEAL_FILE,
    EvidenceError,
    EvidenceStore,
    Finding,
    broken_seals,
    missing_episodes,
    read_seal,
    recompute,
    replay,
)
from integ_gym.support import plural, whole_number

DEPTHS = ("whole", "sealed", "replayed")

SAMPLE = 2000
"""Records that are played again unless more are asked for."""

BLOCK = 4096
"""Records that are in memory at once; those of one setup are played side by side."""

_PAGE = "panel.json"
_PLANNED = ("run.json", _PAGE, "units")
"""What a panel writes, any of which says that there was a plan."""

_TRACED = "SELECT record_id FROM records WHERE reward IS NOT NULL ORDER BY record_id"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """The options of `verify`."""
    add = command.add_argument
    add(
        "--depth", choices=DEPTHS, default=DEPTHS[-1],
        help="whole: hashes, the run's plan, and outcomes from traces; sealed: the run's seal as "
        "well; replayed: episodes simulated again as well, and the seal if there is one (default)",
    )  # fmt: skip
    add(
        "--sample", type=whole_number, default=SAMPLE, metavar="N",
        help=f"records with a trace that are simulated again, drawn by --seed (default: {SAMPLE})",
    )  # fmt: skip
    add("--all", action="store_true", help="simulate all of them again")
    add("--seed", type=whole_number, default=0, metavar="S", help="of the sample (default: 0)")
    add(
        "--exact", action="store_true",
        help=f"let no bit differ, where otherwise numbers within {ELSEWHERE:g} are let pass",
    )  # fmt: skip
    add("--own-code", action="store_true", help="load classes that records name as module:Class")


def verify(store: EvidenceStore, given: argparse.Namespace) -> int:
    """Print what is wrong with a run: 1 if anything is, else 0 and what was checked.

    Args:
        store: of the run.
        given: the options of :func:`add_arguments`.

    Raises:
        EvidenceError: for ``sealed`` without a seal.
    """
    run = store.directory.parent if store.directory.name == "evidence" else store.directory
    sealed = read_seal(run)
    if given.depth == "sealed" and sealed is None:
        raise EvidenceError(f"{run} has no {SEAL_FILE}; `integ-gym panel` writes it at its end")
    found = [str(problem) for problem in store.verify()]
    with contextlib.suppress(*([ValueError] if found else [])):  # what cannot be read is named
        found.extend(map(str, _against_plan(run)))
    with contextlib.suppress(*([ValueError] if found else [])):
        found.extend(map(str, _whole(store)))
    if given.depth != "whole":
        found += map(str, broken_seals(run))
        if sealed is None and (run / _PAGE).exists():
            found.append(f"{SEAL_FILE}: is missing: the run is not finished, or it was removed")
    told: list[str] = []
    if not found and given.depth == "replayed":
        played, told = _replayed(store, given)
        found += played
    for line in found or [*_checked(store, given.depth, sealed), *told]:
        print(line)
    if found:
        print(f"problems in {run}: {len(found)}")
    return 1 if found else 0


def _checked(store: EvidenceStore, depth: str, sealed: Mapping[str, Any] | None) -> Iterator[str]:
    """What was found to be in order before any episode was played again."""
    count, files = store.count(), len(store.files())
    yield f"records: {count}, files: {files}, schema version {SCHEMA_VERSION}"
    yield (
        "whole: every content hash matches, no episode is missing, and outcomes, ledgers and "
        "labels follow from traces and stored replays"
    )
    if sealed is not None and depth != "whole":
        yield f"sealed: {sealed['seal']}"


def _against_plan(run: Path) -> Iterator[Finding]:
    if any((run / name).exists() for name in _PLANNED):
        from integ_gym.eval import against_plan

        yield from against_plan(run)


def _whole(store: EvidenceStore) -> Iterator[Finding]:
    yield from missing_episodes(store)
    for file, record in store.named_records():
        yield from recompute(record, file)


def _replayed(store: EvidenceStore, given: argparse.Namespace) -> tuple[list[str], list[str]]:
    """Deviations of what was played again, and sentences that say what was."""
    ids = store.query(_TRACED).column("record_id").to_pylist()
    count = len(ids) if given.all else min(len(ids), max(0, given.sample))
    chosen = set(random.Random(given.seed).sample(ids, count))
    found: list[str] = []
    played = exact = 0
    skipped: dict[str, int] = {}
    records = store.named_records(chosen) if chosen else iter(())
    while block := list(islice(records, BLOCK)):
        done = replay(block, exact=given.exact, own_code=given.own_code)
        found += map(str, done.findings)
        played, exact = played + done.records, exact + done.exact
        for reason, number in done.skipped.items():
            skipped[reason] = skipped.get(reason, 0) + number
    told = [
        f"replayed: {played} of {plural(len(ids), 'record')} with a trace, {exact} of them to the "
        f"last bit, the others within {ELSEWHERE:g}"
    ]
    told += [f"not replayed: {plural(number, 'record')} {why}" for why, number in skipped.items()]
    without = store.count() - len(ids)
    if without:
        told.append(f"not replayed: {plural(without, 'record')} without a trace")
    return found, told
