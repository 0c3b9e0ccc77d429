"""The seal of a finished run: the SHA-256 of each of its files, in one file with a hash of its own.

That hash pins the whole run: its page quotes it and is not covered itself. It proves that files are
those that were sealed, not who sealed them; a signature says that as well.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from integ_gym.support.files import Kinds, file_hash, read_object, write_json

from ..schema.errors import EvidenceError, Finding

SEAL_FILE = "seal.json"
_LIFTED = f".{SEAL_FILE}"
SIGNATURE_FILE = f"{SEAL_FILE}.sig"
SIGSTORE_FILE = f"{SEAL_FILE}.sigstore.json"
FORMAT = "integ-gym seal 1"

_SEALED = ("*.json", "*.parquet", "evidence/*.parquet", "policies/*/*", "units/*.json")
"""What decides a result; the page and the figures are made of it."""

_KINDS: Kinds = {"format": str, "files": dict, "seal": str}


def seal(run: Path) -> str:
    """Write the seal of a run's directory; a signature of another seal is removed.

    Returns:
        The hash that pins the run, 64 hexadecimal digits.
    """
    content = _made(run)
    lower_seal(run, content)
    if not _holds(run, content):
        for signature in (SIGNATURE_FILE, SIGSTORE_FILE):
            (run / signature).unlink(missing_ok=True)
        write_json(run / SEAL_FILE, content)
    return str(content["seal"])


def _holds(run: Path, content: dict[str, Any]) -> bool:
    """Whether this is the seal that a run has."""
    with suppress(EvidenceError):
        return read_seal(run) == content
    return False


def lift_seal(run: Path) -> None:
    """Put the seal of a run aside, so that it has none while files may be added."""
    with suppress(FileNotFoundError):
        (run / SEAL_FILE).replace(run / _LIFTED)


def lower_seal(run: Path, made: dict[str, Any] | None = None) -> None:
    """Put a seal back that was lifted, if it is still that of the files; if not it is removed.

    Args:
        run: the directory.
        made: the seal of its files as they are, where that is known.
    """
    lifted = run / _LIFTED
    if not lifted.exists():
        return
    with suppress(EvidenceError):
        if _read(lifted) == (made or _made(run)):
            lifted.replace(run / SEAL_FILE)
    lifted.unlink(missing_ok=True)


def _made(run: Path) -> dict[str, Any]:
    files = _hashes(run)
    return {"format": FORMAT, "seal": _pin(files), "files": files}


def read_seal(run: Path) -> dict[str, Any] | None:
    """What the seal of a run says; None if the run is not sealed.

    Raises:
        EvidenceError: if it is damaged.
    """
    return _read(run / SEAL_FILE)


def _read(path: Path) -> dict[str, Any] | None:
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


def unbroken_seal(run: Path) -> str | None:
    """The hash that pins a run; None if it is not sealed, or its files are not those any more."""
    try:
        held = read_seal(run)
    except EvidenceError:
        return None
    return None if held is None or any(broken_seals(run)) else str(held["seal"])


def _hashes(run: Path) -> dict[str, str]:
    """SHA-256 of the files that a seal covers, by their path from the run."""
    files = sorted(file for pattern in _SEALED for file in run.glob(pattern))
    return {
        file.relative_to(run).as_posix(): file_hash(file)
        for file in files
        if file.is_file()
        and file.name not in (SEAL_FILE, SIGSTORE_FILE)
        and not file.name.startswith(".")
    }


def _pin(files: dict[str, str]) -> str:
    text = json.dumps(files, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()
