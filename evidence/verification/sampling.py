"""Which records of a run are played again."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from itertools import groupby, islice
from typing import NamedTuple

from ..episodes.record import EvidenceRecord
from ..store.store import EvidenceStore
from .replaying import UNDECIDED, Acting, Replayed, replay

BLOCK = 4096
"""Records that are in memory at once; those of one setup are played side by side."""

_TRACED = "SELECT record_id FROM records WHERE reward IS NOT NULL ORDER BY record_id"
_CELLS = """
SELECT list(record_id ORDER BY episode_index) AS ids,
       coalesce(list(record_id) FILTER (reward IS NULL), []) AS untraced
FROM records WHERE policy_hash <> ''
GROUP BY env_id, policy_id, policy_hash, cell, phase ORDER BY policy_hash, policy_id, cell, phase
"""

_HOPELESS = "SELECT record_id FROM records WHERE policy_hash = '' {condition}"
_BARE = "AND reward IS NULL"

_Block = list[tuple[str, EvidenceRecord]]


class _Drawn(NamedTuple):
    """Ids of the records that are played again.

    Attributes:
        repeated: with the controls of their traces.
        decided: with what the policy decides again, by cell.
    """

    repeated: frozenset[str]
    decided: frozenset[str]


def replay_some(
    store: EvidenceStore,
    count: int | None,
    chance: random.Random,
    policy: Callable[[EvidenceRecord], Acting],
    *,
    decide: bool = False,
    exact: bool = False,
    own_code: bool = False,
    report: Callable[[int], object] = lambda count: None,
) -> Replayed:
    """Play records of a run again: with recorded controls, or without a trace by their policy.

    Of records without a trace all episodes of a policy in a cell are played, which it sees
    together; those among them that have one are held against it.

    Args:
        store: of the run.
        count: how many, about; None: all.
        chance: draws them.
        policy: see :func:`replay`.
        decide: let the policies decide again where there are traces, too.
        exact: see :func:`replay`.
        own_code: see :func:`replay`.
        report: see :func:`replay`.
    """
    drawn = _drawn(store, count, chance, decide)
    done = Replayed()
    for block in _blocks(store, drawn.repeated):
        done.add(replay(block, exact=exact, own_code=own_code, report=report))
    for block in _files(store, drawn.decided):
        done.add(replay(block, exact=exact, own_code=own_code, policy=policy, report=report))
    done.skip(UNDECIDED, store.query(_HOPELESS.format(condition="" if decide else _BARE)).num_rows)
    return done.settle()


def _drawn(store: EvidenceStore, count: int | None, chance: random.Random, decide: bool) -> _Drawn:
    """Cells until there are enough of their records, and records with traces in proportion."""
    own = "ids" if decide else "untraced"
    cells = [cell for cell in store.query(_CELLS).to_pylist() if cell[own]]
    traced = [] if decide else store.query(_TRACED).column("record_id").to_pylist()
    wanted = sum(len(cell[own]) for cell in cells)
    share = 1.0 if count is None else min(1.0, count / max(1, len(traced) + wanted))
    chance.shuffle(cells)
    decided: set[str] = set()
    drawn = 0
    for cell in cells:
        if drawn < share * wanted:
            decided.update(cell["ids"])
            drawn += len(cell[own])
    rest = [name for name in traced if name not in decided]
    repeated = chance.sample(rest, min(len(rest), round(share * len(traced))))
    return _Drawn(frozenset(repeated), frozenset(decided))


def _blocks(store: EvidenceStore, ids: frozenset[str]) -> Iterator[_Block]:
    records = store.named_records(ids) if ids else iter(())
    while block := list(islice(records, BLOCK)):
        yield block


def _files(store: EvidenceStore, ids: frozenset[str]) -> Iterator[_Block]:
    """By file, where all episodes of a policy in a cell are together."""
    records = store.named_records(ids) if ids else iter(())
    for _, block in groupby(records, key=lambda item: item[0]):
        yield list(block)
