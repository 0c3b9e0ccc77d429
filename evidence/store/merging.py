"""Runs put together in one store, each record once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from ..schema.errors import EvidenceError
from ..schema.extra import pyarrow
from .parquet_file import parts
from .store import EvidenceStore


class Merged(NamedTuple):
    """What a merge did.

    Attributes:
        records: that were written.
        doubled: that were there already, and left out.
    """

    records: int
    doubled: int


def merge(sources: Sequence[EvidenceStore], target: EvidenceStore) -> Merged:
    """Copy the records of several stores into another, file by file.

    A record that is there already, the same by its content hash, is left out. Nothing is written
    if two records of one id differ.

    Args:
        sources: the stores, in the order in which their records are taken.
        target: where to; what it holds counts as there already.

    Raises:
        EvidenceError: for two records of one id with another content, or a damaged source.
    """
    for store in (*sources, target):
        problems = store.verify()
        if problems:
            raise EvidenceError(
                f"{store.directory} is damaged: {problems[0]}; mend it before it is merged"
            )
    held = _ids([target])
    added = _ids(sources, held)
    doubled = sum(store.count() for store in sources) - len(added)
    taken = dict(held)
    for store in sources:
        for file in store.files():
            name = _free(file.stem, target)
            fresh = [table for table in _fresh(parts(file), taken) if table.num_rows]
            if fresh:
                target.commit_all(name, fresh)
    return Merged(len(added), doubled)


def _ids(stores: Sequence[EvidenceStore], held: dict[str, str] | None = None) -> dict[str, str]:
    """Content hash by record id, of the records that are not held.

    Raises:
        EvidenceError: if two records of one id differ.
    """
    known, found = dict(held or {}), {}
    for store in stores:
        if not store.files():
            continue
        for row in store.query("SELECT record_id, content_hash FROM records").to_pylist():
            name, own = row["record_id"], row["content_hash"]
            if known.setdefault(name, own) != own:
                raise EvidenceError(
                    f"record {name} of {store.directory} is another than the one of that id that "
                    "is there already; merge into a directory without it"
                )
            if name not in (held or {}):
                found[name] = own
    return found


def _fresh(tables: Iterator[Any], taken: dict[str, str]) -> Iterator[Any]:
    """Rows whose records have not been taken."""
    for table in tables:
        ids, own = (table.column(n).to_pylist() for n in ("record_id", "content_hash"))
        new = [name not in taken for name in ids]
        taken.update(zip(ids, own, strict=True))
        yield table.filter(pyarrow().array(new, pyarrow().bool_()))


def _free(stem: str, target: EvidenceStore) -> str:
    """A batch name that is not taken."""
    names, count, name = set(target.batches()), 2, stem
    while name in names:
        name, count = f"{stem}-{count}", count + 1
    return name
