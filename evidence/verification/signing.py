"""A signature of a run's seal, as OpenSSH makes and checks them (PROTOCOL.sshsig).

Keys are those of ``ssh-keygen -t ed25519``; ``ssh-keygen -Y verify -n integ-gym`` checks the same
file without this package.
"""

from __future__ import annotations

import base64
import binascii
import getpass
import hashlib
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from integ_gym.support.files.reading import read_bounded
from integ_gym.support.files.writing import replace_file
from integ_gym.support.packages.extras import load

from ..schema.errors import EvidenceError, Finding
from .sealing import SEAL_FILE, SIGNATURE_FILE

NAMESPACE = b"integ-gym"
"""What the signature is for: one made for something else does not pass as one of a seal."""

_MAGIC, _VERSION, _HASH, _KIND = b"SSHSIG", b"\0\0\0\1", b"sha512", b"ssh-ed25519"
_BEGIN, _END = "-----BEGIN SSH SIGNATURE-----", "-----END SSH SIGNATURE-----"
_MOST_BYTES = 1 << 16
_MAKE = "make one with ssh-keygen -t ed25519"

_serialization = partial(load, "cryptography.hazmat.primitives.serialization", "sign")
_exceptions = partial(load, "cryptography.exceptions", "sign")


class Signature(NamedTuple):
    """What stands in a signature's file.

    Attributes:
        key: public key, as OpenSSH encodes it.
        content: 64 bytes.
    """

    key: bytes
    content: bytes

    @property
    def fingerprint(self) -> str:
        """Of the public key, as ``ssh-keygen -l`` shows it."""
        digest = base64.b64encode(hashlib.sha256(self.key).digest()).decode()
        return f"SHA256:{digest.rstrip('=')}"


def read_key(path: Path) -> Any:
    """A private key; its passphrase, if it has one, is asked for on the terminal.

    Raises:
        EvidenceError: if it cannot be read or is of another kind, in one sentence.
        ModuleNotFoundError: if the extra is missing, with the command that installs it.
    """
    content = _content(path)
    try:
        key = _serialization().load_ssh_private_key(content, None)
    except TypeError:
        key = _unlocked(path, content)
    except (ValueError, _unsupported()) as error:
        raise _no_key(path, str(error)) from None
    if _kind_of(key.public_key()) != _KIND:
        raise _no_key(path, "it is of another kind than Ed25519")
    return key


def sign(run: Path, key: Any) -> Signature:
    """Sign the seal of a run, in a file beside it.

    Args:
        run: the directory of a sealed run.
        key: what :func:`read_key` read.
    """
    encoded = base64.b64decode(_public_text(key.public_key()).split()[1])
    content = key.sign(_signed((run / SEAL_FILE).read_bytes()))
    parts = (encoded, NAMESPACE, b"", _HASH, _string(_KIND) + _string(content))
    blob = base64.b64encode(_MAGIC + _VERSION + b"".join(map(_string, parts))).decode()
    lines = [blob[start : start + 70] for start in range(0, len(blob), 70)]
    replace_file(run / SIGNATURE_FILE, "\n".join((_BEGIN, *lines, _END, "")).encode())
    return Signature(encoded, content)


def read_signature(run: Path) -> Signature | None:
    """The signature of a run's seal, which nobody has checked yet; None if it is not signed.

    Raises:
        EvidenceError: if it is damaged, or by another kind of key.
    """
    path = run / SIGNATURE_FILE
    if not path.exists():
        return None
    try:
        return _parsed(_content(path).decode("ascii"))
    except (ValueError, binascii.Error) as error:
        raise EvidenceError(f"{path} is no signature of a seal: {error}; sign it again") from None


def broken_signature(run: Path, public_keys: Path) -> Iterator[Finding]:
    """What is wrong with a run's signature: none, by none of some keys, or of another seal.

    Args:
        run: its directory.
        public_keys: file with a public key of OpenSSH's on each line, such as ``id_ed25519.pub``.

    Raises:
        EvidenceError: for a file without such keys, or a damaged signature.
        ModuleNotFoundError: if the extra is missing, with the command that installs it.
    """
    known, found = _public_keys(public_keys), read_signature(run)
    if found is None:
        yield Finding(SIGNATURE_FILE, None, "is missing: the seal is not signed")
        return
    if found.key not in known:
        yield Finding(SIGNATURE_FILE, None, f"is by {found.fingerprint}, no key of {public_keys}")
        return
    text = _KIND + b" " + base64.b64encode(found.key)
    try:
        key = _serialization().load_ssh_public_key(text)
        key.verify(found.content, _signed((run / SEAL_FILE).read_bytes()))
    except (ValueError, _unsupported(), _exceptions().InvalidSignature):
        yield Finding(SIGNATURE_FILE, None, f"is not of this {SEAL_FILE}")


def _signed(message: bytes) -> bytes:
    """What is signed of a message."""
    parts = (NAMESPACE, b"", _HASH, hashlib.sha512(message).digest())
    return _MAGIC + b"".join(map(_string, parts))


def _string(content: bytes) -> bytes:
    """As SSH writes it: the length in four bytes, then the content."""
    return len(content).to_bytes(4, "big") + content


def _strings(content: bytes) -> Iterator[bytes]:
    """What :func:`_string` wrote, one after the other."""
    while content:
        end = 4 + int.from_bytes(content[:4], "big")
        if len(content) < end or end < 4:
            raise ValueError("it is cut off")
        yield content[4:end]
        content = content[end:]


def _parsed(text: str) -> Signature:
    lines = text.strip().splitlines()
    if len(lines) < 3 or (lines[0], lines[-1]) != (_BEGIN, _END):
        raise ValueError(f"it does not stand between {_BEGIN} and {_END}")
    blob = base64.b64decode("".join(lines[1:-1]), validate=True)
    head = _MAGIC + _VERSION
    if not blob.startswith(head):
        raise ValueError("it is of another version")
    key, namespace, reserved, digest, signature = _exactly(5, blob[len(head) :])
    if (namespace, reserved, digest) != (NAMESPACE, b"", _HASH):
        raise ValueError(f"it was made for {namespace!r} with {digest!r}")
    kind, content = _exactly(2, signature)
    if kind != _KIND or next(_strings(key), b"") != _KIND:
        raise ValueError(f"its key is of another kind than Ed25519; {_MAKE}")
    return Signature(key, content)


def _exactly(count: int, content: bytes) -> list[bytes]:
    found = list(_strings(content))
    if len(found) != count:
        raise ValueError("it is damaged")
    return found


def _public_keys(path: Path) -> set[bytes]:
    words = _content(path).split()
    places = [i + 1 for i, word in enumerate(words[:-1]) if word == _KIND]
    try:
        known = {base64.b64decode(words[place], validate=True) for place in places}
    except binascii.Error:
        known = set()
    if not known:
        raise EvidenceError(
            f"{path} holds no public key of kind ssh-ed25519; give the file that ssh-keygen wrote "
            "with the ending .pub"
        )
    return known


def _content(path: Path) -> bytes:
    try:
        return read_bounded(path, _MOST_BYTES)
    except OSError as error:
        raise EvidenceError(f"cannot read {path}: {error.strerror or error}") from None
    except ValueError as error:
        raise EvidenceError(str(error)) from None


def _unlocked(path: Path, content: bytes) -> Any:
    """A key that has a passphrase."""
    if not sys.stdin.isatty():
        raise EvidenceError(
            f"{path} has a passphrase, which is asked for on a terminal alone; sign there, or with "
            f"ssh-keygen -Y sign -n {NAMESPACE.decode()} -f {path} {SEAL_FILE}"
        )
    try:
        given = getpass.getpass(f"Passphrase of {path}: ")
        return _serialization().load_ssh_private_key(content, given.encode())
    except (ValueError, _unsupported()) as error:
        raise _no_key(path, str(error)) from None


def _no_key(path: Path, reason: str) -> EvidenceError:
    return EvidenceError(f"{path} is no private key that can sign: {reason}; {_MAKE}")


def _unsupported() -> type[Exception]:
    unsupported: type[Exception] = _exceptions().UnsupportedAlgorithm
    return unsupported


def _kind_of(public_key: Any) -> bytes:
    return bytes(_public_text(public_key).split()[0])


def _public_text(public_key: Any) -> bytes:
    form = _serialization()
    text: bytes = public_key.public_bytes(form.Encoding.OpenSSH, form.PublicFormat.OpenSSH)
    return text
