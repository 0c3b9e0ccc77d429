"""Export of records in the formats of other tools."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple, TextIO

from integ_gym.support.errors import InputError
from integ_gym.support.files import cannot_write, new_path
from integ_gym.support.optional import load
from integ_gym.support.processes import work_bar

from ..record import EvidenceRecord
from ..schema import EvidenceError
from ..store import EvidenceStore
from .mcap_files import write_mcap
from .minari_dataset import write_minari
from .parquet_dataset import write_parquet
from .selection import Selection, select, write_csv, write_jsonl

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
        return Exported(_write_text(form, chosen.episodes(trace=False), out), chosen.left_out)
    assert isinstance(out, Path)
    load("tqdm", "exchange")
    with _new(out) as folder, work_bar(f"export {form}", len(chosen.ids), progress) as bar:
        folder.mkdir()
        chosen.report = bar.update
        written = _FOLDERS[form](chosen, folder)
    return Exported(written, chosen.left_out)


def _write_text(form: str, episodes: Episodes, out: Path | TextIO) -> int:
    if not isinstance(out, Path):
        return _TEXTS[form](episodes, out)
    with _new(out) as part, part.open("w", encoding="utf-8", newline="") as file:
        return _TEXTS[form](episodes, file)


@contextmanager
def _new(out: Path) -> Iterator[Path]:
    try:
        with new_path(out) as part:
            yield part
    except FileExistsError:
        raise EvidenceError(f"{out} exists, and is not replaced; give another --out") from None
    except OSError as error:
        raise cannot_write(out, error) from None
