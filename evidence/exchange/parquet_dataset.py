"""Some records of a run as a run of their own: their rows in Parquet, and which part they are."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from integ_gym.support.files import Kinds, file_hash, read_object, write_json

from ..schema import EvidenceError, Finding
from ..store import EvidenceStore
from .selection import Selection

EXPORT_FILE = "export.json"
FORMAT = "integ-gym export 1"

_KINDS: Kinds = {"format": str, "where": str, "records": int, "of": int, "files": dict}


def write_parquet(chosen: Selection, folder: Path) -> int:
    """Write one file of records for each environment; the number of records.

    Rows are copied bit by bit, with their hashes, so that every `integ-gym evidence` command reads
    the folder as a run.
    """
    store = EvidenceStore(folder / "evidence")
    for env_id in chosen.env_ids:
        name = re.sub(r"[^A-Za-z0-9._-]+", "-", env_id).strip("._-") or "environment"
        store.commit_all(name, chosen.tables(env_id))
    write_json(folder / EXPORT_FILE, _describe_export(chosen, store))
    return store.count()


def _describe_export(chosen: Selection, store: EvidenceStore) -> dict[str, Any]:
    """The contents of `export.json`."""
    return {
        "format": FORMAT,
        "where": chosen.where,
        "records": store.count(),
        "of": chosen.store.count(),
        "files": {file.name: file_hash(file) for file in store.files()},
    }


def read_export(folder: Path) -> dict[str, Any] | None:
    """What an exported folder says of itself: `records` that are in it `of` so many; else None.

    Raises:
        EvidenceError: if that is damaged.
    """
    path = folder / EXPORT_FILE
    if not path.exists():
        return None
    try:
        held = read_object(path, _KINDS, "export the records again")
    except ValueError as error:
        raise EvidenceError(str(error)) from None
    if held["format"] != FORMAT:
        raise EvidenceError(f"{path} has format {held['format']!r}, expected {FORMAT!r}")
    return held


def changed_since_export(store: EvidenceStore, held: Mapping[str, Any]) -> Iterator[Finding]:
    """Files of an exported folder that were changed, added or removed since.

    Args:
        store: of the folder.
        held: what :func:`read_export` read.
    """
    now = {file.name: file_hash(file) for file in store.files()}
    for name in sorted({*held["files"], *now}):
        if held["files"].get(name) != now.get(name):
            yield Finding(name, None, f"is not what was exported, as {EXPORT_FILE} says")
