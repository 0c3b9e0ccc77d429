"""Summaries of records as CSV or JSON lines: all fields but the trace, one record per line."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable
from typing import TextIO

from ..episodes.record import EvidenceRecord
from ..schema.fields import SUMMARY_FIELDS


def write_csv(records: Iterable[EvidenceRecord], file: TextIO) -> int:
    """Write records as CSV with a header, lists as JSON; how many.

    Args:
        records: their traces are not needed.
        file: where to, opened with ``newline=""``.
    """
    writer = csv.DictWriter(file, [field.name for field in SUMMARY_FIELDS], lineterminator="\n")
    writer.writeheader()
    count = 0
    for record in records:
        summary = record.summary()
        writer.writerow(summary | {"initial_state": json.dumps(summary["initial_state"])})
        count += 1
    return count


def write_jsonl(records: Iterable[EvidenceRecord], file: TextIO) -> int:
    """Write records as lines of JSON, after the published JSON Schema; how many."""
    count = 0
    for record in records:
        file.write(json.dumps(record.summary(), ensure_ascii=False, allow_nan=False) + "\n")
        count += 1
    return count
