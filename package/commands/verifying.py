"""``integ-gym evidence verify``: whole, sealed, replayed."""

from __future__ import annotations

import argparse
import contextlib
import random
from collections.abc import Callable, Iterator
from pathlib import Path

from integ_gym.evidence import (
    ELSEWHERE,
    SCHEMA_VERSION,
    SEAL_FILE,
    Acting,
    EvidenceError,
    EvidenceRecord,
    EvidenceStore,
    Finding,
    Replayed,
    broken_seals,
    broken_signature,
    missing_episodes,
    read_seal,
    read_signature,
    recompute,
    replay,
)
from integ_gym.support import plural, whole_number

DEPTHS = ("whole", "sealed", "replayed")

SAMPLE = 2000
"""Records that are played again unless more are asked for."""

_PLAN = "run.json"

_TRACED = "SELECT record_id FROM records WHERE reward IS NOT NULL ORDER BY record_id"
_UNTRACED = "SELECT record_id FROM records WHERE reward IS NULL"
_BY_CELL = """
SELECT list(record_id ORDER BY episode_index) AS ids FROM records
GROUP BY env_id, phase, policy_id, policy_hash, cell ORDER BY policy_hash, policy_id, cell, phase
"""


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
    add(
        "--policy", action="store_true",
        help="let the policies of the run decide again, where otherwise recorded controls are "
        "repeated: of whole cells of a policy, with records that have no trace",
    )  # fmt: skip
    add("--own-code", action="store_true", help="load classes that records name as module:Class")
    add(
        "--public-key", type=Path, metavar="FILE",
        help="demand a signature of the seal by a key of this file, such as id_ed25519.pub",
    )  # fmt: skip


def verify(store: EvidenceStore, given: argparse.Namespace) -> int:
    """Print what is wrong with a run: 1 if anything is, else 0 and what was checked.

    Args:
        store: of the run.
        given: the options of :func:`add_arguments`.

    Raises:
        EvidenceError: for ``sealed`` or a signature without a seal.
    """
    run = store.run
    sealed = read_seal(run)
    if sealed is None and (given.depth == "sealed" or given.public_key is not None):
        raise EvidenceError(
            f"{run} has no {SEAL_FILE}; `integ-gym panel` writes it at its end, and `integ-gym "
            "evidence seal` of any run"
        )
    if given.depth == "whole" and given.public_key is not None:
        raise EvidenceError("--public-key is about the seal; leave --depth whole out")
    found = [str(problem) for problem in store.verify()]
    with contextlib.suppress(*([ValueError] if found else [])):
        found.extend(map(str, _against_plan(run)))
    if not found:
        found += map(str, _whole(store))
    if given.depth != "whole":
        found += map(str, broken_seals(run))
    if given.public_key is not None:
        found += map(str, broken_signature(run, given.public_key))
    told = [
        f"records: {store.count()}, files: {len(store.files())}, schema version {SCHEMA_VERSION}",
        "whole: every content hash matches, no episode is missing, and outcomes, ledgers and "
        "labels follow from traces and stored replays",
    ]
    if sealed is not None and given.depth != "whole":
        told.append(f"sealed: {sealed['seal']}")
        told += _signed(run, given)
    if given.depth == "replayed" and not found:
        played, sentences = _replayed(store, given)
        found += played
        told += sentences
    for line in found or told:
        print(line)
    if found:
        print(f"problems in {run}: {len(found)}")
    return 1 if found else 0


def _signed(run: Path, given: argparse.Namespace) -> list[str]:
    signature = read_signature(run)
    if signature is None:
        return []
    if given.public_key is not None:
        return [f"signed: by {signature.fingerprint}, of {given.public_key}"]
    return [f"signed: by {signature.fingerprint}, not checked without --public-key"]


def _against_plan(run: Path) -> Iterator[Finding]:
    if (run / _PLAN).exists():
        from integ_gym.eval import against_plan

        yield from against_plan(run)


def _whole(store: EvidenceStore) -> Iterator[Finding]:
    yield from missing_episodes(store)
    for file, record in store.named_records():
        yield from recompute(record, file)


def _replayed(store: EvidenceStore, given: argparse.Namespace) -> tuple[list[str], list[str]]:
    """Deviations of what was played again, and sentences that say what was."""
    chosen = (_cells if given.policy else _records)(store, given)
    policy = _policies(store, given.own_code) if given.policy else None
    done = Replayed()
    for file in store.files():
        own = [(name, r) for name, r in store.named_records(file.name) if r["record_id"] in chosen]
        done.add(replay(own, exact=given.exact, own_code=given.own_code, policy=policy))
    count = store.count()
    told = [
        f"replayed: {done.records} of {plural(count, 'record')}, {done.exact} of them to the last "
        f"bit, the others within {ELSEWHERE:g}"
    ]
    told += [
        f"not replayed: {plural(number, 'record')} {why}" for why, number in done.skipped.items()
    ]
    left = count - done.records - sum(done.skipped.values())
    if left:
        told.append(f"not replayed: {plural(left, 'record')} not drawn, see --all")
    return list(map(str, done.findings)), told


def _records(store: EvidenceStore, given: argparse.Namespace) -> set[str]:
    """Ids of the records that are played again with their controls, those without trace aside."""
    ids = store.query(_TRACED).column("record_id").to_pylist()
    count = len(ids) if given.all else min(len(ids), max(0, given.sample))
    without = store.query(_UNTRACED).column("record_id").to_pylist()
    return {*random.Random(given.seed).sample(ids, count), *without}


def _cells(store: EvidenceStore, given: argparse.Namespace) -> set[str]:
    """Ids of the records of cells, each with all episodes of a policy, as many as are wanted."""
    cells = store.query(_BY_CELL).column("ids").to_pylist()
    random.Random(given.seed).shuffle(cells)
    chosen: set[str] = set()
    for ids in cells:
        if given.all or len(chosen) < given.sample:
            chosen.update(ids)
    return chosen


def _policies(store: EvidenceStore, own_code: bool) -> Callable[[EvidenceRecord], Acting]:
    """What gives the policy of a record, found once for all its cells."""
    from integ_gym.eval import policy_of

    found: dict[tuple[str, str], Acting] = {}

    def policy(record: EvidenceRecord) -> Acting:
        key = (record["policy_id"], record["policy_hash"])
        if key not in found:
            found[key] = policy_of(record, store, own_code).act
        return found[key]

    return policy
