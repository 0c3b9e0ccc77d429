"""``integ-gym evidence {show,query,verify,seal,export,merge}``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

from integ_gym.evidence.schema.errors import EvidenceError
from integ_gym.evidence.store.elsewhere import query_in_place
from integ_gym.evidence.store.merging import merge
from integ_gym.evidence.store.printing import TABLE_FORMATS, print_table
from integ_gym.evidence.store.showing import ASCII_BARS, BARS, show
from integ_gym.evidence.store.store import EvidenceStore, open_run
from integ_gym.support.files.writing import make_folder
from integ_gym.support.storing.places import fetched, is_remote
from integ_gym.support.terminal.command_line import CommandParser
from integ_gym.support.terminal.text_table import FITS, width_of

from . import exporting, sealing, verifying

_EXAMPLES = """\
examples:
  integ-gym evidence query runs/panel "SELECT policy_id, cell, avg(success::INT) AS success
                                       FROM records WHERE phase = 'evaluation' GROUP BY ALL"
  integ-gym evidence query runs/panel "SELECT record_id, failure_reason FROM records
                                       WHERE failure_label = 'discretization_error' LIMIT 5"
  integ-gym evidence query s3://bucket/panel "SELECT count(*) FROM records"
  integ-gym evidence show runs/panel 3f9a
  integ-gym evidence verify runs/panel
  integ-gym evidence verify runs/panel --all --exact
  integ-gym evidence verify runs/panel --policy
  integ-gym evidence seal runs/panel --sign ~/.ssh/id_ed25519
  integ-gym evidence verify runs/panel --public-key id_ed25519.pub
  integ-gym evidence export runs/panel --to csv --out summaries.csv
  integ-gym evidence export runs/panel --to minari --out datasets --where "phase = 'evaluation'"
  integ-gym evidence export runs/panel --to mcap --out logs --where "NOT success"
  integ-gym evidence merge runs/one runs/two --out runs/both

RUN is the directory of a run, or its directory `evidence`, or the place of a run in an object
store: s3://…, gs://…, az://…. `query` reads it there; the others read a copy that they fetch first.
"""


def main(argv: Sequence[str]) -> int:
    """Run the command: 0, or 1 if ``verify`` found a problem.

    Raises:
        EvidenceError: on bad input, in one sentence.
    """
    given = parser().parse_args(argv)
    if given.run_command is _query and is_remote(given.run):
        print_table(query_in_place(given.run, given.sql), sys.stdout, given.format)
        return 0
    if given.run_command is _seal and is_remote(given.run):
        raise EvidenceError(
            f"{given.run} is no run on this machine, as one that is sealed must be; a panel's is "
            "sealed when it is finished, and any other once it is copied here"
        )
    runs = given.run if isinstance(given.run, list) else [given.run]
    with ExitStack() as copies:
        stores = [open_run(copies.enter_context(fetched(run))) for run in runs]
        return int(given.run_command(given, *stores))


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    made = CommandParser(
        prog="integ-gym evidence",
        description=f"Look at, check and export the evidence records of a run. {FITS}",
        epilog=_EXAMPLES,
    )
    commands = made.add_subparsers(required=True, metavar="{show,query,verify,seal,export,merge}")

    def add(
        name: str, run: Callable[..., int], purpose: str, several: str | None = None
    ) -> argparse.ArgumentParser:
        command = commands.add_parser(name, help=purpose)
        told = "directory of a run, or its `evidence`"
        command.add_argument("run", metavar="RUN", nargs=several, help=told)
        command.set_defaults(run_command=run)
        return command

    command = add("show", _show, "print one record with its units")
    command.add_argument("record_id", metavar="RECORD_ID", help="its id, or how the id begins")

    command = add("query", _query, "run SQL over the view `records`")
    command.add_argument("sql", metavar="SQL", help="a statement in DuckDB's dialect")
    command.add_argument(
        "--format", choices=TABLE_FORMATS, default="table",
        help="csv and json give every value in full; a table shortens numbers and long lists, and "
        "of many columns prints each in a line with its unit, long texts cut (default: table)",
    )  # fmt: skip

    command = add("verify", _verify, "hold a run against its hashes, plan, traces and replays")
    verifying.add_arguments(command)

    command = add("seal", _seal, "seal a run, and sign the seal")
    sealing.add_arguments(command)

    command = add("export", _export, "write records in the format of another tool")
    exporting.add_arguments(command)

    command = add("merge", _merge, "put the records of several runs together, each once", "+")
    command.add_argument("--out", required=True, metavar="DIR", type=Path, help="where to")
    return made


def _show(arguments: argparse.Namespace, store: EvidenceStore) -> int:
    record = store.find(arguments.record_id)
    bars = BARS if _can_print(BARS) else ASCII_BARS
    print(show(record, bars, width_of(sys.stdout)))
    return 0


def _query(arguments: argparse.Namespace, store: EvidenceStore) -> int:
    print_table(store.query(arguments.sql), sys.stdout, arguments.format)
    return 0


def _verify(arguments: argparse.Namespace, store: EvidenceStore) -> int:
    return verifying.verify(store, arguments)


def _seal(arguments: argparse.Namespace, store: EvidenceStore) -> int:
    return sealing.seal_run(store, arguments)


def _merge(arguments: argparse.Namespace, *stores: EvidenceStore) -> int:
    done = merge(stores, EvidenceStore(make_folder(arguments.out) / "evidence"))
    print(f"{done.records} records written to {arguments.out}, {done.doubled} were there already")
    return 0


def _export(arguments: argparse.Namespace, store: EvidenceStore) -> int:
    return exporting.run(store, arguments)


def _can_print(text: str) -> bool:
    try:
        text.encode(sys.stdout.encoding or "ascii")
    except UnicodeEncodeError:
        return False
    return True
