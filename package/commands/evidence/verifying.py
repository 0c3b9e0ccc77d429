"""``integ-gym evidence verify``: whole, sealed, replayed."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from integ_gym.evidence.exchange.parquet_export.dataset import changed_since_export, read_export
from integ_gym.evidence.schema.errors import EvidenceError, Finding
from integ_gym.evidence.schema.fields import SCHEMA_VERSION
from integ_gym.evidence.store.store import EvidenceStore
from integ_gym.evidence.verification.gaps import missing_episodes, other_columns
from integ_gym.evidence.verification.recomputing import recompute
from integ_gym.evidence.verification.replaying import ELSEWHERE
from integ_gym.evidence.verification.sealing import SEAL_FILE, broken_seals, read_seal
from integ_gym.evidence.verification.signing import broken_signature, read_signature
from integ_gym.support.terminal.formatting import plural
from integ_gym.support.terminal.options import whole_number

from ..work_options import add_progress
from .checking import HASH_SECONDS, REPLAY_SECONDS, TRACE_SECONDS, Checking
from .replaying import replayed

DEPTHS = ("whole", "sealed", "replayed")

SAMPLE = 2000
"""Records that are played again unless more are asked for."""

_PAGE = "panel.json"
_PLANNED = ("run.json", _PAGE, "units")
"""What a panel writes, any of which says that there was a plan."""


def add_arguments(command: argparse.ArgumentParser) -> None:
    """The options of `verify`."""
    add = command.add_argument
    add(
        "--depth", choices=DEPTHS, default=DEPTHS[-1],
        help="whole: hashes, the run's plan, and outcomes from traces; sealed: the run's seal as "
        "well; replayed: episodes simulated again as well, and the seal if there is one (default)",
    )  # fmt: skip
    add(
        "--sample", type=whole_number, default=SAMPLE, metavar="N",
        help="records that are simulated again, about, drawn by --seed; those without a trace by "
        f"whole cells of a policy (default: {SAMPLE})",
    )  # fmt: skip
    add("--all", action="store_true", help="simulate all of them again")
    add("--seed", type=whole_number, default=0, metavar="S", help="of the sample (default: 0)")
    add(
        "--exact", action="store_true",
        help=f"let no bit differ, where otherwise numbers within {ELSEWHERE:g} are let pass",
    )  # fmt: skip
    add(
        "--policy", action="store_true",
        help="let the policies of the run decide again everywhere, where otherwise they do without "
        "a trace alone, and recorded controls are repeated",
    )  # fmt: skip
    add("--own-code", action="store_true", help="load classes that records name as module:Class")
    add(
        "--public-key", type=Path, metavar="FILE",
        help="demand a signature of the seal by a key of this file, such as id_ed25519.pub",
    )  # fmt: skip
    add_progress(command)


def verify(store: EvidenceStore, given: argparse.Namespace) -> int:
    """Print what is wrong with a run: 1 if anything is, else 0 and what was checked.

    Args:
        store: of the run.
        given: the options of :func:`add_arguments`.

    Raises:
        EvidenceError: for ``sealed`` or a signature without a seal, and a sample below 0.
    """
    if given.sample < 0:
        raise EvidenceError(f"--sample must be 0 or above, got {given.sample}")
    run = store.run
    sealed, exported = read_seal(run), read_export(run)
    if sealed is None and (given.depth == "sealed" or given.public_key is not None):
        raise EvidenceError(
            f"{run} has no {SEAL_FILE}; `integ-gym panel` writes it at its end, and `integ-gym "
            "evidence seal` of any run"
        )
    if given.depth == "whole" and given.public_key is not None:
        raise EvidenceError("--public-key is about the seal; leave --depth whole out")
    checking = Checking(_seconds(store, given), not given.no_progress)
    with contextlib.closing(checking):
        found, told = _found(store, given, sealed, exported, checking)
    for line in found or [*_checked(store, given, sealed, exported), *told]:
        print(line)
    if found:
        print(f"problems in {run}: {len(found)}")
    return 1 if found else 0


def _found(
    store: EvidenceStore,
    given: argparse.Namespace,
    sealed: Mapping[str, Any] | None,
    exported: Mapping[str, Any] | None,
    checking: Checking,
) -> tuple[list[str], list[str]]:
    """What is wrong with a run, and sentences that say what was played again."""
    run = store.run
    report = checking.begin("hashes", HASH_SECONDS)
    found = [str(problem) for problem in store.verify(report)]
    report = checking.begin("outcomes from traces", TRACE_SECONDS)
    _collect(found, _whole(store, exported, report))
    checking.begin("plan and verdicts")
    if any((run / name).exists() for name in _PLANNED):
        from integ_gym.eval.panel.checking.page import against_plan

        _collect(found, against_plan(run, given.own_code, given.all))
    if given.depth != "whole":
        checking.begin("seal")
        _collect(found, broken_seals(run))
        if sealed is None and (run / _PAGE).exists():
            found.append(f"{SEAL_FILE}: is missing: the run is not finished, or it was removed")
    if given.public_key is not None:
        found += map(str, broken_signature(run, given.public_key))
    if given.depth != "replayed" or not all(line.startswith(_PAGE) for line in found):
        return found, []
    played, told = replayed(store, given, checking.begin("playing again", REPLAY_SECONDS))
    return found + played, told


def _seconds(store: EvidenceStore, given: argparse.Namespace) -> float:
    """Time that checking a run takes, about, s."""
    count = 0
    with contextlib.suppress(EvidenceError):  # what cannot be read is a finding
        count = store.count()
    again = count if given.all else min(count, given.sample)
    replays = again * REPLAY_SECONDS if given.depth == "replayed" else 0.0
    return count * (HASH_SECONDS + TRACE_SECONDS) + replays


def _checked(
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
        part = "no episode is missing between those that are there (the run is not finished)"
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
    signature = read_signature(store.run)
    if signature is not None:
        key = given.public_key
        how = "not checked without --public-key" if key is None else f"of {key}"
        yield f"signed: by {signature.fingerprint}, {how}"


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
        yield from changed_since_export(store, exported)
    yield from missing_episodes(store, part=exported is not None)
    yield from other_columns(store)
    for file, record in store.named_records():
        yield from recompute(record, file)
        report(1)
