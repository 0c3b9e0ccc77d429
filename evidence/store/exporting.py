"""Summaries of records as CSV or JSON lines."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterable
from typing import Any, TextIO

from ..episodes import EvidenceRecord
from ..schema import SUMMARY_FIELDS

EXPORT_FORMATS = ("csv", "jsonl")


def export(records: Iterable[EvidenceRecord], file: TextIO, form: str) -> int:
    """Write all fields but the trace, one record per line.

    Args:
        records: the records; their traces are not needed.
        file: where to, opened with ``newline=""``.
        form: ``"csv"`` or ``"jsonl"``.

    Returns:
        The number of records.

    Raises:
        ValueError: for another format.
    """
    if form not in EXPORT_FORMATS:
        raise ValueError(f"the format must be one of {', '.join(EXPORT_FORMATS)}, got {form!r}")
    write = _csv_writer(file) if form == "csv" else _json_writer(file)
    count = 0
    for record in records:
        write(record.summary())
        count += 1
    return count


def _csv_writer(file: TextIO) -> Callable[[dict[str, Any]], None]:
    writer = csv.DictWriter(file, [field.name for field in SUMMARY_FIELDS], lineterminator="\n")
    writer.writeheader()

    def write(summary: dict[str, Any]) -> None:
        writer.writerow(summary | {"initial_state": json.dumps(summary["initial_state"])})

    return write


def _json_writer(file: TextIO) -> Callable[[dict[str, Any]], None]:
    def write(summary: dict[str, Any]) -> None:
        file.write(json.dumps(summary, ensure_ascii=False, allow_nan=False) + "\n")

    return write
