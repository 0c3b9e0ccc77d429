"""The seal of a finished run: the SHA-256 of each of its files, in one file with a hash of its own.

That hash pins the whole run. It proves that files are those that were sealed, not who sealed them;
a signature says that as well.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from integ_gym.support import Kinds, file_hash, read_object, write_json

from ..schema import EvidenceError, Finding

SEAL_FILE = "seal.json"
FORMAT = "integ-gym seal 1"

_SEALED = ("*.json", "evidence/*.parquet", "policies/*/*", "units/*.json")
"""What decides a result; the page and the figures are made of it."""

_KINDS: Kinds = {"format": str, "files": dict, "seal": str}


def seal(run: Path) -> str:
    """Write the seal of a run's directory.

    Returns:
        The hash that pins the run, 64 hexadecimal digits.
    """
    files = _hashes(run)
    pinned = _pin(files)
    write_json(run / SEAL_FILE, {"format": FORMAT, "seal": pinned, "files": files})
    return pinned


def read_seal(run: Path) -> dict[str, Any] | None:
    """What the seal of a run says; None if the run is not sealed.

    Raises:
        EvidenceError: if it is damaged.
    """
    path = run / SEAL_FILE
    if not path.exists():
        return None
    try:
        held = read_object(path, _KINDS, "restore it from a copy")
    except ValueError as error:
        raise EvidenceError(str(error)) from None
    if held["format"] != FORMAT:
        raise EvidenceError(
            f"{path} has format {held['format']!r}, expected {FORMAT!r}; read it with the version "
            "that wrote it"
        )
    return held


def broken_seals(run: Path) -> Iterator[Finding]:
    """Files of a sealed run that were changed, added or removed since; none if it is not sealed."""
    held = read_seal(run)
    if held is None:
        return
    if held["seal"] != _pin(held["files"]):
        yield Finding(SEAL_FILE, None, "its own hash does not fit the files that it lists")
    now = _hashes(run)
    for name in sorted({*held["files"], *now}):
        if name not in now:
            yield Finding(name, None, "is sealed and missing")
        elif name not in held["files"]:
            yield Finding(name, None, "is not of the sealed run")
        elif now[name] != held["files"][name]:
            yield Finding(name, None, "was changed after the run was sealed")


def _hashes(run: Path) -> dict[str, str]:
    """SHA-256 of the files that a seal covers, by their path from the run."""
    files = sorted(file for pattern in _SEALED for file in run.glob(pattern))
    return {
        file.relative_to(run).as_posix(): file_hash(file)
        for file in files
        if file.is_file() and file.name != SEAL_FILE and not file.name.startswith(".")
    }


def _pin(files: dict[str, str]) -> str:
    text = json.dumps(files, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()
