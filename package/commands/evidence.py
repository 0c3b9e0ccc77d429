"""``integ-gym evidence``: show, query, verify, seal, export and merge records."""

from __future__ import annotations

import argparse
import contextlib
import csv
import random
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from integ_gym.evidence import exporting, printing, replaying, sealing
from integ_gym.evidence.fields import SCHEMA_VERSION
from integ_gym.evidence.parquet_file import query_in_place
from integ_gym.evidence.recomputing import recompute
from integ_gym.evidence.record import EvidenceRecord
from integ_gym.evidence.schema import EvidenceError, Finding
from integ_gym.evidence.store import EvidenceStore, merge, open_run
from integ_gym.support.files import make_folder
from integ_gym.support.interpreters import make_interpreter
from integ_gym.support.optional import require
from integ_gym.support.options import CommandParser, whole_number
from integ_gym.support.storage import is_remote, local_copy
from integ_gym.support.terminal import FITS, WorkBar, plural, print_wrapped, width_of

from .work_options import add_progress

HASH_SECONDS, TRACE_SECONDS, REPLAY_SECONDS = 1e-4, 2e-4, 1e-2
"""Time of one record, s: of its hash, of its outcome from its trace, of playing it again."""


def report_phase(bar: WorkBar, phase: str, each: float = 0.0) -> Callable[[int], None]:
    """Say what is checked now; what counts the records of it.

    Args:
        bar: over all that is checked.
        phase: in words.
        each: time that one takes, s.
    """
    bar.describe(phase)
    return lambda count: bar.update(count * each)


def export_records(given: argparse.Namespace, store: EvidenceStore) -> int:
    """Export records, and say how many were and were not: 0.

    Raises:
        EvidenceError: on bad input, in one sentence.
    """
    if given.out is None and given.form not in exporting.TEXT_FORMATS:
        raise EvidenceError(f"{given.form} is a folder of files; say where with --out DIR")
    out = sys.stdout if given.out is None else given.out
    done = exporting.export(
        store, given.form, out, where=given.where, progress=not given.no_progress
    )
    if given.out is not None:
        print(f"{plural(done.records, 'record')} written to {given.out}", file=sys.stderr)
    for reason, count in done.left_out.items():
        print(f"left out: {plural(count, 'record')} {reason}", file=sys.stderr)
    return 0


def replay(
    store: EvidenceStore, given: argparse.Namespace, report: Callable[[int], object]
) -> tuple[list[str], list[str]]:
    """Deviations of what was played again, and sentences that say what was.

    Args:
        store: of the run.
        given: ``all``, ``sample``, ``seed``, ``exact``, ``own_code`` and ``policy`` of `verify`.
        report: called now and then with the number of further records that are done.
    """
    done = replaying.replay_some(
        store,
        None if given.all else max(0, given.sample),
        random.Random(given.seed),
        partial(_acting, store, given.own_code),
        decide=given.policy,
        exact=given.exact,
        own_code=given.own_code,
        report=report,
    )
    count = store.count()
    exact = f"{done.exact} of them to the last bit"
    if done.exact < done.records:
        exact += f", the others within {replaying.ELSEWHERE:g}"
    sentences = [f"replayed: {done.records} of {plural(count, 'record')}, {exact}"]
    if done.sensitive:
        sentences.append(
            f"sensitive: {plural(len(done.sensitive), 'record')} further off, but within what "
            "rounding grows to: most records differ in a bit, so another machine made them"
        )
    sentences += [
        f"not replayed: {plural(n, 'record')} {why}" for why, n in done.skipped.items() if n
    ]
    sentences += [
        f"not decided again: {plural(n, 'record')} {why}; fallbacks are counted as recorded"
        for why, n in done.undecided.items()
    ]
    left = count - done.records - sum(done.skipped.values())
    if left:
        sentences.append(f"not replayed: {plural(left, 'record')} not drawn, see --all")
    return list(map(str, done.findings)), sentences


def _acting(store: EvidenceStore, own_code: bool, record: EvidenceRecord) -> replaying.Acting:
    """The policy of a record."""
    return _policies(store, own_code)(record)


@lru_cache(maxsize=1)
def _policies(store: EvidenceStore, own_code: bool) -> Callable[[EvidenceRecord], replaying.Acting]:
    """What gives the policy of a record, loaded when it is first asked for, in any process."""
    from integ_gym.eval.panel.policies import ActingIn

    return ActingIn(store, own_code)


def _make_interpreters(store: EvidenceStore, progress: bool) -> None:
    """Make the interpreters with the package versions of a run's cells that are not there.

    Raises:
        InterpreterError: for one that cannot be made.
    """
    for packages, records in replaying.records_by_packages(store).items():

        def report(words: str) -> None:
            if progress:
                print(f"{words[0].upper()}{words[1:]} …", file=sys.stderr)

        make_interpreter(packages, replaying.versions_for_replay(records), report)


def seal_run(given: argparse.Namespace, store: EvidenceStore) -> int:
    """Seal a run, sign the seal if a key is given, and print both: 0.

    Raises:
        EvidenceError: if the run has a seal that does not hold, or the key cannot sign.
    """
    run = store.run
    if given.sign is not None:
        sealing.check_key(given.sign)
    for broken in sealing.find_broken_seals(run):
        raise EvidenceError(
            f"{run} has a seal that does not hold: {broken}; find out why, and remove "
            f"{run / sealing.SEAL_FILE} to seal what is there now"
        )
    print(f"Seal: {sealing.seal(run)}")
    if given.sign is not None:
        print(f"Signed by {sealing.sign(run, given.sign)}")
    return 0


DEPTHS = ("whole", "sealed", "replayed")

SAMPLE = 2000
"""Records that are played again unless more are asked for."""

_PAGE = "panel.json"
_PLANNED = ("run.json", _PAGE, "units")
"""What a panel writes, any of which says that there was a plan."""


def verify(given: argparse.Namespace, store: EvidenceStore) -> int:
    """Print what is wrong with a run: 1 if anything is, else 0 and what was checked.

    Raises:
        EvidenceError: for ``sealed`` or a signature without a seal, and a sample below 0.
    """
    if given.sample < 0:
        raise EvidenceError(f"--sample must be 0 or above, got {given.sample}")
    run = store.run
    sealed, exported = sealing.read_seal(run), exporting.read_export(run)
    if sealed is None and (given.depth == "sealed" or given.public_key is not None):
        raise EvidenceError(
            f"{run} has no {sealing.SEAL_FILE}; finish the run with the command that began it, or "
            "seal it with `integ-gym evidence seal`"
        )
    if given.depth == "whole" and given.public_key is not None:
        raise EvidenceError(
            "--public-key checks the seal, which --depth whole leaves out; omit --depth"
        )
    if given.make_interpreters:
        _make_interpreters(store, not given.no_progress)
    with WorkBar("verify", _seconds(store, given), not given.no_progress) as bar:
        found, sentences = _find_problems(store, given, sealed, exported, bar)
        bar.describe("", draw=False)
    count = len(found) - found.count(_NOT_PLAYED)
    print(f"{plural(count, 'problem') if found else 'No problem'} found in {run}.")
    for line in found or [*_report_checks(store, given, sealed, exported), *sentences]:
        print_wrapped(line)
    return 1 if found else 0


_NOT_PLAYED = "not replayed: any record, until what is named above is mended"


def _find_problems(
    store: EvidenceStore,
    given: argparse.Namespace,
    sealed: Mapping[str, Any] | None,
    exported: Mapping[str, Any] | None,
    bar: WorkBar,
) -> tuple[list[str], list[str]]:
    """What is wrong with a run, and sentences that say what was played again."""
    run = store.run
    report = report_phase(bar, "hashes", HASH_SECONDS)
    found = [str(problem) for problem in store.verify(report)]
    report = report_phase(bar, "outcomes from traces", TRACE_SECONDS)
    _collect(found, _whole(store, exported, report))
    report_phase(bar, "plan and verdicts")
    if any((run / name).exists() for name in _PLANNED):
        from integ_gym.eval.panel.checking.page import against_plan

        _collect(found, against_plan(run, given.own_code, given.all))
    if given.depth != "whole":
        report_phase(bar, "seal")
        _collect(found, sealing.find_broken_seals(run))
        if sealed is None and (run / _PAGE).exists():
            found.append(
                f"{sealing.SEAL_FILE}: is missing: the run is not finished, or it was removed"
            )
    if given.public_key is not None or (given.depth != "whole" and sealing.can_check_signatures()):
        found += map(str, sealing.find_signature_faults(run, given.public_key))
    if given.depth != "replayed":
        return found, []
    if not all(line.startswith(_PAGE) for line in found):
        return [*found, _NOT_PLAYED], []
    played, sentences = replay(store, given, report_phase(bar, "playing again", REPLAY_SECONDS))
    return found + played, sentences


def _seconds(store: EvidenceStore, given: argparse.Namespace) -> float:
    """Time that checking a run takes, about, s."""
    count = 0
    with contextlib.suppress(EvidenceError):  # what cannot be read is a finding
        count = store.count()
    again = count if given.all else min(count, given.sample)
    replays = again * REPLAY_SECONDS if given.depth == "replayed" else 0.0
    return count * (HASH_SECONDS + TRACE_SECONDS) + replays


def _report_checks(
    store: EvidenceStore,
    given: argparse.Namespace,
    sealed: Mapping[str, Any] | None,
    exported: Mapping[str, Any] | None,
) -> Iterator[str]:
    """What was found to be in order before any episode was played again."""
    count, files = store.count(), len(store.files())
    yield f"records: {count}, files: {files}, schema version {SCHEMA_VERSION}"
    if exported is None:
        planned = any((store.run / name).exists() for name in _PLANNED)
        whole = "no episode is missing"
        part = "no episode is missing among those that are there (the run is not finished)"
        complete = part if planned and sealed is None else whole
    else:
        complete = "nothing was changed since the export"
        yield (
            f"exported: {exported['records']} of {plural(exported['of'], 'record')} of a run, "
            f"those that are {exported['where']!r}"
        )
    yield (
        f"whole: every content hash matches, {complete}, and outcomes, ledgers and labels follow "
        "from traces and stored replays"
    )
    if sealed is None or given.depth == "whole":
        return
    yield f"sealed: {sealed['seal']}"
    if not (store.run / sealing.SIGNATURE_FILE).exists():
        return
    if not sealing.can_check_signatures():
        yield "signed: not checked, because ssh-keygen is not installed"
    elif given.public_key is None:
        signer = sealing.read_signer(store.run)
        yield f"signed: by {signer}; --public-key FILE checks whose key that is"
    else:
        yield f"signed: by {sealing.read_signer(store.run)}, a key of {given.public_key}"


def _collect(found: list[str], findings: Iterator[Finding]) -> None:
    """Add what a check finds, and what ends the check, unless that was found before."""
    try:
        for finding in findings:
            found.append(str(finding))
    except ValueError as error:
        if not any(str(error) in line for line in found):
            found.append(str(error))


def _whole(
    store: EvidenceStore, exported: Mapping[str, Any] | None, report: Callable[[int], None]
) -> Iterator[Finding]:
    if exported is not None:
        yield from exporting.find_changes_since_export(store, exported)
    yield from replaying.missing_episodes(store, part=exported is not None)
    yield from replaying.other_columns(store)
    for file, record in store.named_records():
        yield from recompute(record, file)
        report(1)


_EXAMPLES = """\
examples:
  integ-gym evidence query runs/panel "SELECT policy_id, cell,
      avg(success::INT) AS success FROM records GROUP BY ALL"
  integ-gym evidence query runs/panel "SELECT record_id FROM records
      WHERE failure_label = 'discretization_error' LIMIT 5"
  integ-gym evidence query s3://bucket/panel "SELECT count(*) FROM records"
  integ-gym evidence show runs/panel 3f9a
  integ-gym evidence show runs/go1 3f9a --substeps steps.csv --own-code
  integ-gym evidence verify runs/panel
  integ-gym evidence verify runs/panel --all --exact
  integ-gym evidence verify runs/panel --policy
  integ-gym evidence seal runs/panel --sign ~/.ssh/id_ed25519
  integ-gym evidence verify runs/panel --public-key id_ed25519.pub
  integ-gym evidence export runs/panel --to csv --out summaries.csv
  integ-gym evidence export runs/panel --to minari --out datasets \\
      --where "phase = 'evaluation'"
  integ-gym evidence export runs/panel --to mcap --out logs \\
      --where "NOT success"
  integ-gym evidence merge runs/one runs/two --out runs/both

RUN is the directory of a run, or its directory `evidence`, or a place in an
object store: s3://…, gs://…, az://…. `query` reads it there; the others fetch a
copy first.
"""


def main(argv: Sequence[str]) -> int:
    """Run the command: 0, or 1 if ``verify`` found a problem.

    Raises:
        EvidenceError: on bad input, in one sentence.
    """
    given = parser().parse_args(argv)
    require("evidence")
    if given.run_command is _query and is_remote(given.run):
        printing.print_table(query_in_place(given.run, given.sql), sys.stdout, given.format)
        return 0
    if given.run_command is seal_run and is_remote(given.run):
        raise EvidenceError(
            f"{given.run} is no run on this machine, as one that is sealed must be; a panel's is "
            "sealed when it is finished, and any other once it is copied here"
        )
    runs = given.run if isinstance(given.run, list) else [given.run]
    with ExitStack() as copies:
        stores = [open_run(copies.enter_context(local_copy(run))) for run in runs]
        return int(given.run_command(given, *stores))


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    arguments = CommandParser(
        prog="integ-gym evidence",
        description=f"Look at, check and export the evidence records of a run. {FITS}",
        epilog=_EXAMPLES,
    )
    commands = arguments.add_subparsers(
        required=True, metavar="{show,query,verify,seal,export,merge}"
    )

    def add(
        name: str, run: Callable[..., int], purpose: str, several: str | None = None
    ) -> argparse.ArgumentParser:
        command = commands.add_parser(name, help=purpose)
        where = "directory of a run, or its `evidence`"
        command.add_argument("run", metavar="RUN", nargs=several, help=where)
        command.set_defaults(run_command=run)
        return command

    command = add("show", _show, "print one record with its units")
    command.add_argument("record_id", metavar="RECORD_ID", help="record id or unique prefix")
    command.add_argument(
        "--substeps", metavar="FILE", type=Path,
        help="for a robot's record, with --own-code: play it again and write every timestep as csv",
    )  # fmt: skip
    command.add_argument(
        "--own-code", action="store_true", help="load the class that the record names"
    )

    command = add("query", _query, "run SQL over the view `records`")
    command.add_argument("sql", metavar="SQL", help="a statement in DuckDB's dialect")
    command.add_argument(
        "--format", choices=printing.TABLE_FORMATS, default="table",
        help="csv and json give every value in full; a table shortens numbers and long lists. If "
        "its columns do not fit, each row is printed as a list, one line per column, with units "
        "(default: table)",
    )  # fmt: skip

    command = add("verify", verify, "check a run: hashes, plan, traces, seal and replays")
    command.add_argument(
        "--depth", choices=DEPTHS, default=DEPTHS[-1],
        help="whole: hashes, the run's plan, and outcomes from traces; sealed: also the seal; "
        "replayed: also episodes simulated again (default; the seal only if there is one)",
    )  # fmt: skip
    command.add_argument(
        "--sample", type=whole_number, default=SAMPLE, metavar="N",
        help="about how many records are simulated again, drawn by --seed; those without a trace "
        f"in whole cells of a policy (default: {SAMPLE})",
    )  # fmt: skip
    command.add_argument("--all", action="store_true", help="simulate all of them again")
    command.add_argument(
        "--seed",
        type=whole_number,
        default=0,
        metavar="S",
        help="seed that draws the sample (default: 0)",
    )
    command.add_argument(
        "--exact", action="store_true",
        help="require bit-identical replays; otherwise relative differences of "
        f"{replaying.ELSEWHERE:g} pass",
    )  # fmt: skip
    command.add_argument(
        "--policy", action="store_true",
        help="let the run's policies decide again in all evaluations; by default recorded controls "
        "are repeated, and policies decide only where there is no trace",
    )  # fmt: skip
    command.add_argument(
        "--own-code", action="store_true", help="load classes that records name as module:Class"
    )
    command.add_argument(
        "--make-interpreters", action="store_true",
        help="make interpreters with the package versions of cells that this machine lacks, with "
        "uv; without them those cells are not simulated again",
    )  # fmt: skip
    command.add_argument(
        "--public-key", type=Path, metavar="FILE",
        help="demand a signature of the seal by a key of this file, such as id_ed25519.pub; needs "
        "ssh-keygen",
    )  # fmt: skip
    add_progress(command)

    command = add("seal", seal_run, "seal a run, and sign the seal")
    command.add_argument(
        "--sign", type=Path, metavar="KEY",
        help="sign it with this private key through ssh-keygen",
    )  # fmt: skip

    command = add("export", export_records, "write records in the format of another tool")
    command.add_argument(
        "--to", choices=exporting.EXPORT_FORMATS, default=exporting.EXPORT_FORMATS[0], dest="form",
        help="csv, jsonl: all fields but the trace, in one file; parquet: a run of the "
        "chosen records; minari: a data set of episodes; mcap: a log of ROS 2 messages for each "
        "episode (default: csv)",
    )  # fmt: skip
    command.add_argument(
        "--out", metavar="PATH", type=Path,
        help="where to, which must not be there yet: a file for csv and jsonl (default: standard "
        "output), a folder for the others",
    )  # fmt: skip
    command.add_argument(
        "--where", metavar="SQL", default="TRUE",
        help="export records that meet this condition (default: all)",
    )  # fmt: skip
    add_progress(command)

    command = add("merge", _merge, "put the records of several runs together, each once", "+")
    command.add_argument(
        "--out", required=True, metavar="DIR", type=Path, help="directory of the merged run"
    )
    return arguments


def _show(arguments: argparse.Namespace, store: EvidenceStore) -> int:
    record = store.find(arguments.record_id)
    if arguments.substeps is not None:
        columns = replaying.play_substeps(record, arguments.own_code)
        with arguments.substeps.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows(zip(*columns.values(), strict=True))
        print(f"{plural(len(columns['time']), 'timestep')} written to {arguments.substeps}")
        return 0
    bars = printing.BARS
    try:
        bars.encode(sys.stdout.encoding or "ascii")
    except UnicodeEncodeError:
        bars = printing.ASCII_BARS
    print(printing.show(record, bars, width_of(sys.stdout)))
    return 0


def _query(arguments: argparse.Namespace, store: EvidenceStore) -> int:
    printing.print_table(store.query(arguments.sql), sys.stdout, arguments.format)
    return 0


def _merge(arguments: argparse.Namespace, *stores: EvidenceStore) -> int:
    done = merge(stores, EvidenceStore(make_folder(arguments.out) / "evidence"))
    print(f"{done.records} records written to {arguments.out}, {done.doubled} were there already")
    return 0
