"""Seals: one hash over a run, and signatures of it by ssh-keygen."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from integ_gym.support.files import Kinds, file_hash, read_object, replace_file, write_json

from .schema import EvidenceError, Finding

SEAL_FILE = "seal.json"
_SUSPENDED = f".{SEAL_FILE}"
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
    content = _build_seal(run)
    restore_seal(run, content)
    known = None
    with suppress(EvidenceError):
        known = read_seal(run)
    if known != content:
        for signature in (SIGNATURE_FILE, SIGSTORE_FILE):
            (run / signature).unlink(missing_ok=True)
        write_json(run / SEAL_FILE, content)
    return str(content["seal"])


def suspend_seal(run: Path) -> None:
    """Put the seal of a run aside, so that it has none while files may be added."""
    with suppress(FileNotFoundError):
        (run / SEAL_FILE).replace(run / _SUSPENDED)


def restore_seal(run: Path, content: dict[str, Any] | None = None) -> None:
    """Put a seal back that was suspended, if it is still that of the files; if not it is removed.

    Args:
        run: the directory.
        content: the seal of its files as they are, where that is known.
    """
    suspended = run / _SUSPENDED
    if not suspended.exists():
        return
    with suppress(EvidenceError):
        if read_seal(run, _SUSPENDED) == (content or _build_seal(run)):
            suspended.replace(run / SEAL_FILE)
    suspended.unlink(missing_ok=True)


def _build_seal(run: Path) -> dict[str, Any]:
    files = _hash_files(run)
    return {"format": FORMAT, "seal": _pin(files), "files": files}


def read_seal(run: Path, name: str = SEAL_FILE) -> dict[str, Any] | None:
    """What the seal of a run, in the file of that name, says; None if the run is not sealed.

    Raises:
        EvidenceError: if it is damaged.
    """
    return read_stated(run / name, _KINDS, FORMAT, "restore it from a copy")


def read_stated(path: Path, kinds: Kinds, form: str, remedy: str) -> dict[str, Any] | None:
    """A JSON object whose `format` is ``form``; None if there is no such file.

    Raises:
        EvidenceError: if it is damaged, or has another format.
    """
    if not path.exists():
        return None
    try:
        content = read_object(path, kinds, remedy)
    except ValueError as error:
        raise EvidenceError(str(error)) from None
    if content["format"] != form:
        raise EvidenceError(
            f"{path} has format {content['format']!r}, expected {form!r}; read it with the version "
            "that wrote it"
        )
    return content


def find_broken_seals(run: Path) -> Iterator[Finding]:
    """Files of a sealed run that were changed, added or removed since; none if it is not sealed."""
    held = read_seal(run)
    if held is None:
        return
    if held["seal"] != _pin(held["files"]):
        yield Finding(SEAL_FILE, None, "its own hash does not fit the files that it lists")
    now = _hash_files(run)
    for name in sorted({*held["files"], *now}):
        if name not in now:
            yield Finding(name, None, "is sealed and missing")
        elif name not in held["files"]:
            yield Finding(name, None, "is not of the sealed run")
        elif now[name] != held["files"][name]:
            yield Finding(name, None, "was changed after the run was sealed")


def read_valid_seal(run: Path) -> str | None:
    """The hash that pins a run; None if it is not sealed, or its files are not those any more."""
    try:
        held = read_seal(run)
    except EvidenceError:
        return None
    return None if held is None or any(find_broken_seals(run)) else str(held["seal"])


def _hash_files(run: Path) -> dict[str, str]:
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


NAMESPACE = "integ-gym"
"""What a signature is for: one that was made for anything else is no signature of a seal."""

_FINGERPRINT = re.compile(r"SHA256:\S+")


def can_check_signatures() -> bool:
    """Whether ``ssh-keygen`` is installed."""
    return shutil.which("ssh-keygen") is not None


def check_key(key: Path) -> None:
    """Sign a trial message, so that a key that cannot sign is refused before work begins.

    Raises:
        EvidenceError: if the key cannot sign, or ``ssh-keygen`` is not installed.
    """
    _sign(key, b"")


def sign(run: Path, key: Path) -> str:
    """Sign the seal of a run and write the signature beside it.

    Args:
        run: the directory of a sealed run.
        key: private key, or the public key of one that ``ssh-agent`` holds. A passphrase is asked
            for by ``ssh-keygen``.

    Returns:
        The fingerprint of the key, as ``ssh-keygen -l`` prints it.

    Raises:
        EvidenceError: if the key cannot sign, or ``ssh-keygen`` is not installed.
    """
    replace_file(run / SIGNATURE_FILE, _sign(key, (run / SEAL_FILE).read_bytes()))
    return read_signer(run)


def read_signer(run: Path) -> str:
    """Fingerprint of the key that signed the seal of a run.

    Raises:
        EvidenceError: if the signature is damaged or of another file, or ``ssh-keygen`` is not
            installed.
    """
    signer, reason = _check_signature(run)
    if signer is None:
        raise EvidenceError(f"{run / SIGNATURE_FILE} {reason}")
    return signer


def find_signature_faults(run: Path, public_keys: Path | None) -> Iterator[Finding]:
    """What is wrong with a run's signature.

    Args:
        run: its directory.
        public_keys: file with a public key on each line, such as ``id_ed25519.pub``, one of which
            must have signed; None accepts a signature by any key, or none.

    Raises:
        EvidenceError: for a file without public keys, or if ``ssh-keygen`` is not installed.
    """
    known = None if public_keys is None else _read_fingerprints(public_keys)
    if not ((run / SEAL_FILE).exists() and (run / SIGNATURE_FILE).exists()):
        if known is not None:
            yield Finding(SIGNATURE_FILE, None, "is missing: the seal is not signed")
        return
    signer, reason = _check_signature(run)
    if signer is None:
        yield Finding(SIGNATURE_FILE, None, reason)
    elif known is not None and signer not in known:
        yield Finding(SIGNATURE_FILE, None, f"is by {signer}, no key of {public_keys}")


def _check_signature(run: Path) -> tuple[str | None, str]:
    """The signer's fingerprint, or None and why the signature does not hold."""
    done = _run_ssh_keygen(
        "-Y", "check-novalidate", "-n", NAMESPACE, "-s", str(run / SIGNATURE_FILE),
        message=(run / SEAL_FILE).read_bytes(),
    )  # fmt: skip
    found = _FINGERPRINT.search(done.stdout.decode(errors="replace"))
    if done.returncode or found is None:
        return None, f"is no signature of this {SEAL_FILE}: {_get_last_line(done.stderr)}"
    return found[0], ""


def _sign(key: Path, message: bytes) -> bytes:
    done = _run_ssh_keygen("-Y", "sign", "-n", NAMESPACE, "-f", str(key), message=message)
    if done.returncode:
        raise EvidenceError(
            f"{key} cannot sign: {_get_last_line(done.stderr)}; make a key with ssh-keygen -t "
            "ed25519, or load one that has a passphrase with ssh-add and give its public key"
        )
    return done.stdout


def _read_fingerprints(public_keys: Path) -> set[str]:
    done = _run_ssh_keygen("-l", "-f", str(public_keys))
    lines = done.stdout.decode(errors="replace").splitlines()
    if done.returncode or not lines:
        raise EvidenceError(
            f"{public_keys} holds no public key: {_get_last_line(done.stderr)}; give the file that "
            "ssh-keygen wrote with the ending .pub"
        )
    return {line.split()[1] for line in lines}


def _run_ssh_keygen(*arguments: str, message: bytes = b"") -> subprocess.CompletedProcess[bytes]:
    if not can_check_signatures():
        raise EvidenceError(
            "signatures need ssh-keygen, which is not installed: install OpenSSH 8.2 or later "
            "(Debian: apt install openssh-client)"
        )
    return subprocess.run(["ssh-keygen", *arguments], input=message, capture_output=True)


def _get_last_line(message: bytes) -> str:
    lines = message.decode(errors="replace").strip().splitlines()
    return lines[-1].strip() if lines else "ssh-keygen gave no reason"
