"""A signature of a run's seal, which ``ssh-keygen -Y`` makes and checks (PROTOCOL.sshsig)."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

from integ_gym.support.files.writing import replace_file

from ..schema.errors import EvidenceError, Finding
from .sealing import SEAL_FILE, SIGNATURE_FILE

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


def broken_signature(run: Path, public_keys: Path | None) -> Iterator[Finding]:
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
