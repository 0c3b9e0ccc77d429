"""Summaries of records as CSV or JSON lines."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable
from typing import TextIO

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
    writer = csv.DictWriter(file, [field.name for field in SUMMARY_FIELDS], lineterminator="\n")
    if form == "csv":
        writer.writeheader()
    count = 0
    for record in records:
        summary = record.summary()
        if form == "csv":
            writer.writerow(summary | {"initial_state": json.dumps(summary["initial_state"])})
        else:
            file.write(json.dumps(summary, ensure_ascii=False, allow_nan=False) + "\n")
        count += 1
    return count
