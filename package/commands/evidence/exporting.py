"""``integ-gym evidence export``: records in the format of another tool."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from integ_gym.evidence.exchange.exporting import EXPORT_FORMATS, TEXT_FORMATS, export
from integ_gym.evidence.schema.errors import EvidenceError
from integ_gym.evidence.store.store import EvidenceStore
from integ_gym.support.terminal.formatting import plural

from ..work_options import add_progress


def add_arguments(command: argparse.ArgumentParser) -> None:
    """The options of `export`."""
    add = command.add_argument
    add(
        "--to", choices=EXPORT_FORMATS, default=EXPORT_FORMATS[0], dest="form",
        help="csv, jsonl: all fields but the trace, in one file; parquet: records as they are, "
        "with a data card and a Croissant description; minari, lerobot: data sets of episodes; "
        "mcap: a log of ROS 2 messages for each episode (default: csv)",
    )  # fmt: skip
    add(
        "--out", metavar="PATH", type=Path,
        help="where to, which must not be there yet: a file for csv and jsonl (default: standard "
        "output), a folder for the others",
    )  # fmt: skip
    add(
        "--where", metavar="SQL", default="TRUE",
        help="export records that meet this condition (default: all)",
    )  # fmt: skip
    add_progress(command)


def run(store: EvidenceStore, given: argparse.Namespace) -> int:
    """Export records, and say how many were and were not: 0.

    Raises:
        EvidenceError: on bad input, in one sentence.
    """
    if given.out is None and given.form not in TEXT_FORMATS:
        raise EvidenceError(f"{given.form} is a folder of files; say where with --out DIR")
    out = sys.stdout if given.out is None else given.out
    done = export(store, given.form, out, where=given.where, progress=not given.no_progress)
    if given.out is not None:
        print(f"{plural(done.records, 'record')} written to {given.out}", file=sys.stderr)
    for reason, count in done.left_out.items():
        print(f"left out: {plural(count, 'record')} {reason}", file=sys.stderr)
    return 0
