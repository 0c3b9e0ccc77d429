"""Export of records in the formats of other tools."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, TextIO

from integ_gym.support.errors import InputError
from integ_gym.support.files import Kinds, cannot_write, file_hash, new_path, write_json
from integ_gym.support.terminal import WorkBar

from .mcap_files import write_mcap
from .minari_dataset import write_minari
from .record import EvidenceRecord
from .schema import EvidenceError, Finding
from .sealing import read_stated
from .selection import Selection, select, write_csv, write_jsonl
from .store import EvidenceStore

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
    content = {
        "format": FORMAT,
        "where": chosen.where,
        "records": store.count(),
        "of": chosen.store.count(),
        "files": {file.name: file_hash(file) for file in store.files()},
    }
    write_json(folder / EXPORT_FILE, content)
    return store.count()


def read_export(folder: Path) -> dict[str, Any] | None:
    """What an exported folder says of itself: `records` that are in it `of` so many; else None.

    Raises:
        EvidenceError: if that is damaged.
    """
    return read_stated(folder / EXPORT_FILE, _KINDS, FORMAT, "export the records again")


def find_changes_since_export(store: EvidenceStore, held: Mapping[str, Any]) -> Iterator[Finding]:
    """Files of an exported folder that were changed, added or removed since.

    Args:
        store: of the folder.
        held: what :func:`read_export` read.
    """
    now = {file.name: file_hash(file) for file in store.files()}
    for name in sorted({*held["files"], *now}):
        if held["files"].get(name) != now.get(name):
            yield Finding(name, None, f"is not what was exported, as {EXPORT_FILE} says")


Episodes = Iterator[EvidenceRecord]

_TEXTS: dict[str, Callable[[Episodes, TextIO], int]] = {"csv": write_csv, "jsonl": write_jsonl}

_FOLDERS: dict[str, Callable[[Selection, Path], int]] = {
    "parquet": write_parquet,
    "minari": write_minari,
    "mcap": write_mcap,
}

_OF_TRACES = ("minari", "mcap")
"""Formats of what happened step by step."""

TEXT_FORMATS = tuple(_TEXTS)
"""Formats that are one file of text; the others are a folder."""

EXPORT_FORMATS = (*_TEXTS, *_FOLDERS)


class Exported(NamedTuple):
    """What an export did.

    Attributes:
        records: that were written.
        left_out: why records were not, in words, to how many.
    """

    records: int
    left_out: dict[str, int]


def export(
    store: EvidenceStore,
    form: str,
    out: Path | TextIO,
    *,
    where: str = "TRUE",
    progress: bool = False,
) -> Exported:
    """Write records in another format; docs/reference/evidence.md has what each carries and loses.

    Args:
        store: of the run.
        form: one of `EXPORT_FORMATS`.
        out: where to, which must not be there yet: a file for `TEXT_FORMATS`, also one that is
            open and was opened with ``newline=""``; a folder for the others.
        where: condition in SQL on the columns of the records.
        progress: show a bar on standard error.

    Raises:
        EvidenceError: if there is such a path, for a condition that DuckDB refuses or that no
            record meets, and for records that the format cannot hold.
        ModuleNotFoundError: if an extra is missing, with the command that installs it.
        ValueError: for another format, or where nothing can be written.
    """
    if form not in EXPORT_FORMATS:
        raise InputError(f"the format must be one of {', '.join(EXPORT_FORMATS)}, got {form!r}")
    chosen = select(store, where, traced=form in _OF_TRACES)
    if form in _TEXTS:
        episodes = chosen.episodes(trace=False)
        if not isinstance(out, Path):
            return Exported(_TEXTS[form](episodes, out), chosen.left_out)
        with _new(out) as part, part.open("w", encoding="utf-8", newline="") as file:
            return Exported(_TEXTS[form](episodes, file), chosen.left_out)
    assert isinstance(out, Path)
    with _new(out) as folder, WorkBar(f"export {form}", len(chosen.ids), progress) as bar:
        folder.mkdir()
        chosen.report = bar.update
        written = _FOLDERS[form](chosen, folder)
    return Exported(written, chosen.left_out)


@contextmanager
def _new(out: Path) -> Iterator[Path]:
    try:
        with new_path(out) as part:
            yield part
    except FileExistsError:
        raise EvidenceError(f"{out} exists, and is not replaced; give another --out") from None
    except OSError as error:
        raise cannot_write(out, error) from None
