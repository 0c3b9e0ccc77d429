"""Episodes of a run that `evidence verify` plays again, and what it says of them."""

from __future__ import annotations

import argparse
import random
from collections.abc import Callable, Iterator
from itertools import groupby, islice

from integ_gym.evidence import ELSEWHERE, Acting, EvidenceRecord, EvidenceStore, Replayed, replay
from integ_gym.support import plural

BLOCK = 4096
"""Records that are in memory at once; those of one setup are played side by side."""

_TRACED = "SELECT record_id FROM records WHERE reward IS NOT NULL ORDER BY record_id"
_BY_CELL = """
SELECT list(record_id ORDER BY episode_index) AS ids FROM records
GROUP BY env_id, phase, policy_id, policy_hash, cell ORDER BY policy_hash, policy_id, cell, phase
"""

_Records = Iterator[tuple[str, EvidenceRecord]]


def replayed(store: EvidenceStore, given: argparse.Namespace) -> tuple[list[str], list[str]]:
    """Deviations of what was played again, and sentences that say what was.

    Args:
        store: of the run.
        given: ``all``, ``sample``, ``seed``, ``exact``, ``own_code`` and ``policy`` of `verify`.
    """
    chosen = set(_of_cells(store, given) if given.policy else _of_traces(store, given))
    policy = _policies(store, given.own_code) if given.policy else None
    done, count = Replayed(), store.count()
    records: _Records = store.named_records(chosen) if chosen else iter(())
    for block in _files(records) if given.policy else _blocks(records):
        done.add(replay(block, exact=given.exact, own_code=given.own_code, policy=policy))
    if not given.policy:
        without = count - store.query(_TRACED).num_rows
        done.skip("without a trace", without)
    told = [
        f"replayed: {done.records} of {plural(count, 'record')}, {done.exact} of them to the last "
        f"bit, the others within {ELSEWHERE:g}"
    ]
    told += [f"not replayed: {plural(n, 'record')} {why}" for why, n in done.skipped.items() if n]
    left = count - done.records - sum(done.skipped.values())
    if left:
        told.append(f"not replayed: {plural(left, 'record')} not drawn, see --all")
    return list(map(str, done.findings)), told


def _of_traces(store: EvidenceStore, given: argparse.Namespace) -> list[str]:
    """Ids of the records with a trace that are played again."""
    ids: list[str] = store.query(_TRACED).column("record_id").to_pylist()
    count = len(ids) if given.all else min(len(ids), max(0, given.sample))
    return random.Random(given.seed).sample(ids, count)


def _of_cells(store: EvidenceStore, given: argparse.Namespace) -> Iterator[str]:
    """Ids of the records of cells, each with all episodes of a policy, as many as are wanted."""
    cells = store.query(_BY_CELL).column("ids").to_pylist()
    random.Random(given.seed).shuffle(cells)
    drawn = 0
    for ids in cells:
        if given.all or drawn < given.sample:
            yield from ids
            drawn += len(ids)


def _blocks(records: _Records) -> Iterator[list[tuple[str, EvidenceRecord]]]:
    while block := list(islice(records, BLOCK)):
        yield block


def _files(records: _Records) -> Iterator[list[tuple[str, EvidenceRecord]]]:
    """By file, where all episodes of a policy in a cell are together."""
    for _, block in groupby(records, key=lambda item: item[0]):
        yield list(block)


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
