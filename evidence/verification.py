"""What is wrong with records: findings, gaps, and which are drawn for replay."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from itertools import groupby, islice
from typing import Any, NamedTuple

from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.support.optional import package_version
from integ_gym.support.terminal import plural

from .episode_log import told_setup
from .fields import (
    FIRST_WRITTEN,
    LATER_ATTEMPT,
    SCHEMA_VERSION,
    SECOND_HORIZON,
    record_fields,
)
from .parquet_file import check_schema, read
from .record import EvidenceRecord
from .replaying import (
    UNDECIDED,
    Acting,
    Replayed,
    replay,
)
from .schema import ENV_KEY, VERSION_KEY, EvidenceError, Finding, described, parse_field
from .store import EvidenceStore

_COUNTED = """
SELECT phase, cell, policy_id, policy_hash, min(episode_index) AS first, max(episode_index) AS last,
       count(DISTINCT episode_index) AS present, count(*) AS records
FROM records GROUP BY ALL HAVING present < last - first + 1 OR records > present
ORDER BY phase, cell, policy_id, policy_hash
"""


_OF_FAILURES = (SECOND_HORIZON, LATER_ATTEMPT)
"""Phases that hold the episodes alone that failed within one horizon."""


def missing_episodes(store: EvidenceStore, part: bool = False) -> Iterator[Finding]:
    """Cells in which episodes between the first and the last are missing, or there twice.

    Args:
        store: of the records.
        part: whether they are a part of a run's, of which some may be missing.
    """
    for row in store.query(_COUNTED).to_pylist():
        some = part or row["phase"] in _OF_FAILURES
        missing = 0 if some else row["last"] - row["first"] + 1 - row["present"]
        twice = row["records"] - row["present"]
        episodes = f"of episodes {row['first']} to {row['last']}"
        counts = [f"{missing} missing {episodes}"] if missing else []
        counts += [f"{plural(twice, 'record')} too many {episodes}"] if twice else []
        if counts:
            yield Finding(_named(row), None, ", ".join(counts))


def _named(row: dict[str, Any]) -> str:
    return f"cell {row['cell']!r}, policy {row['policy_id']!r}"


_MEANT = ("unit", "frame", "at")
"""What a column's metadata says of its numbers; the rest are words."""


def other_columns(store: EvidenceStore) -> Iterator[Finding]:
    """Columns of our own environments whose unit, frame or place in time is told otherwise.

    Files of earlier schema versions are left out; of records that say that this version of
    integ-gym made them, an earlier schema version is found.

    Raises:
        EvidenceError: for a file that cannot be read.
    """
    for file in store.files():
        schema = check_schema(file)
        told = {key.decode(): value.decode() for key, value in schema.metadata.items()}
        rows = read(file, columns=["env_id", "arguments", "schema_version", "package_versions"])
        for name, key in (("env_id", ENV_KEY), ("schema_version", VERSION_KEY)):
            said = told.get(key.decode())
            if any(str(value) != said for value in set(rows.column(name).to_pylist())):
                yield Finding(file.name, None, f"its metadata say {name} {said!r}, its records not")
        version, own = told[VERSION_KEY.decode()], package_version("integ-gym")
        made_by = map(_maker, set(rows.column("package_versions").to_pylist()))
        if int(version) < FIRST_WRITTEN and own in made_by:
            message = (
                f"it has schema version {version}, and its records say that integ-gym {own} made "
                f"them, which writes {SCHEMA_VERSION}"
            )
            yield Finding(file.name, None, message)
        env_id = told.get(ENV_KEY.decode(), "")
        if int(version) < FIRST_WRITTEN or env_id not in ENVIRONMENTS:
            continue
        setup = told_setup(env_id, rows.column("arguments")[0].as_py())
        for field in record_fields(setup.plant, setup.task):
            if field.since > int(version):
                continue
            found = described(schema.field(field.name)) if field.name in schema.names else {}
            for about in _MEANT:
                wanted = getattr(field, about)
                if found.get(about) != wanted:
                    message = (
                        f"column {field.name}: {about} is {found.get(about)!r}, not {wanted!r}"
                    )
                    yield Finding(file.name, None, message)


def _maker(package_versions: str) -> str | None:
    """Version of integ-gym that made a record; None where it does not say."""
    try:
        return str(parse_field("package_versions", package_versions)["integ-gym"])
    except (EvidenceError, LookupError, TypeError):
        return None


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
