"""``integ-gym evidence verify``: whole, sealed, replayed."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from integ_gym.evidence import (
    ELSEWHERE,
    SCHEMA_VERSION,
    SEAL_FILE,
    EvidenceError,
    EvidenceStore,
    Finding,
    broken_seals,
    broken_signature,
    changed_since_export,
    missing_episodes,
    read_export,
    read_seal,
    read_signature,
    recompute,
)
from integ_gym.support import plural, whole_number

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


def verify(store: EvidenceStore, given: argparse.Namespace) -> int:
    """Print what is wrong with a run: 1 if anything is, else 0 and what was checked.

    Args:
        store: of the run.
        given: the options of :func:`add_arguments`.

    Raises:
        EvidenceError: for ``sealed`` or a signature without a seal.
    """
    if given.sample < 1:
        raise EvidenceError(f"--sample must be 1 or above, got {given.sample}")
    run = store.run
    sealed, exported = read_seal(run), read_export(run)
    if sealed is None and (given.depth == "sealed" or given.public_key is not None):
        raise EvidenceError(
            f"{run} has no {SEAL_FILE}; `integ-gym panel` writes it at its end, and `integ-gym "
            "evidence seal` of any run"
        )
    if given.depth == "whole" and given.public_key is not None:
        raise EvidenceError("--public-key is about the seal; leave --depth whole out")
    found = [str(problem) for problem in store.verify()]
    with contextlib.suppress(*([ValueError] if found else [])):  # what cannot be read is named
        found.extend(map(str, _whole(store, exported)))
    sound = not found
    found += _against_plan(run, given.own_code, sound)
    if given.depth != "whole":
        found += map(str, broken_seals(run))
        if sealed is None and (run / _PAGE).exists():
            found.append(f"{SEAL_FILE}: is missing: the run is not finished, or it was removed")
    if given.public_key is not None:
        found += map(str, broken_signature(run, given.public_key))
    told: list[str] = []
    if given.depth == "replayed" and all(line.startswith(_PAGE) for line in found):
        played, told = replayed(store, given)
        found += played
    for line in found or [*_checked(store, given, sealed, exported), *told]:
        print(line)
    if found:
        print(f"problems in {run}: {len(found)}")
    return 1 if found else 0


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
        complete = "no episode is missing"
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


def _against_plan(run: Path, own_code: bool, sound: bool) -> list[str]:
    """What contradicts the plan; what cannot be read is an error where the records are sound."""
    if not any((run / name).exists() for name in _PLANNED):
        return []
    from integ_gym.eval import against_plan

    found: list[str] = []
    with contextlib.suppress(*([] if sound else [ValueError])):
        found.extend(map(str, against_plan(run, own_code)))
    return found


def _whole(store: EvidenceStore, exported: Mapping[str, Any] | None) -> Iterator[Finding]:
    if exported is not None:
        yield from changed_since_export(store, exported)
    yield from missing_episodes(store, part=exported is not None)
    for file, record in store.named_records():
        yield from recompute(record, file)
