"""A seal's signature: by whom, of what, and read by OpenSSH as well."""

from __future__ import annotations

import base64

import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec, ed25519
from hypothesis import given
from hypothesis import strategies as st

from integ_gym.cli import main
from integ_gym.evidence.schema.errors import EvidenceError
from integ_gym.evidence.verification.sealing import SEAL_FILE, SIGNATURE_FILE, seal
from integ_gym.evidence.verification.signing import (
    broken_signature,
    read_key,
    read_signature,
    sign,
)

OPENSSH_SIGNATURE = """\
-----BEGIN SSH SIGNATURE-----
U1NIU0lHAAAAAQAAADMAAAALc3NoLWVkMjU1MTkAAAAgA6EHv/POEL4dcN0Y50vAmWfk1j
CbpQ1fHdyGZBJVMbgAAAAJaW50ZWctZ3ltAAAAAAAAAAZzaGE1MTIAAABTAAAAC3NzaC1l
ZDI1NTE5AAAAQJh3Ql+6YrmxJwaXyVGfe57VHvCqy+Z3KqNNJ9zVeJ45l9E6w+F4A4o0+a
aHjY2bOHL4FNLT6UDQLmM1fJqx5g4=
-----END SSH SIGNATURE-----
"""
"""What `ssh-keygen -Y sign -n integ-gym` wrote for `OPENSSH_SEAL`, with the key of these bytes."""

OPENSSH_BYTES = bytes(range(32))
OPENSSH_SEAL = '{"seal": "abc"}\n'


def _written(path, key, password=None):
    form = serialization.PrivateFormat.OpenSSH
    hidden = (
        serialization.NoEncryption()
        if password is None
        else serialization.BestAvailableEncryption(password)
    )
    path.write_bytes(key.private_bytes(serialization.Encoding.PEM, form, hidden))
    public = key.public_key().public_bytes(
        serialization.Encoding.OpenSSH, serialization.PublicFormat.OpenSSH
    )
    path.with_suffix(".pub").write_bytes(public + b" somebody\n")
    return path


@pytest.fixture
def key(tmp_path):
    return _written(tmp_path / "key", ed25519.Ed25519PrivateKey.generate())


@pytest.fixture
def run(tmp_path):
    directory = tmp_path / "run"
    directory.mkdir()
    (directory / "panel.json").write_text('{"rows": []}')
    seal(directory)
    return directory


def _found(run, key):
    return [finding.message for finding in broken_signature(run, key.with_suffix(".pub"))]


def test_a_signature_is_by_the_key_and_of_the_seal(run, key, tmp_path):
    assert _found(run, key) == ["is missing: the seal is not signed"]
    signature = sign(run, read_key(key))
    assert _found(run, key) == []
    assert read_signature(run) == signature
    other = _written(tmp_path / "other", ed25519.Ed25519PrivateKey.generate())
    (found,) = _found(run, other)
    assert found.startswith(f"is by {signature.fingerprint}, no key of ")
    (run / SEAL_FILE).write_text((run / SEAL_FILE).read_text() + " ")
    assert _found(run, key) == [f"is not of this {SEAL_FILE}"]


def test_a_signature_goes_with_its_seal(run, key):
    sign(run, read_key(key))
    seal(run)
    assert _found(run, key) == []
    (run / "panel.json").write_text("{}")
    seal(run)
    assert not (run / SIGNATURE_FILE).exists()


def test_openssh_and_we_make_the_same_signature(tmp_path):
    """Ed25519 signatures are determined by key and message."""
    path = _written(tmp_path / "key", ed25519.Ed25519PrivateKey.from_private_bytes(OPENSSH_BYTES))
    (tmp_path / SEAL_FILE).write_text(OPENSSH_SEAL)
    sign(tmp_path, read_key(path))
    assert (tmp_path / SIGNATURE_FILE).read_text() == OPENSSH_SIGNATURE
    assert _found(tmp_path, path) == []


@given(data=st.data())
def test_what_a_changed_byte_makes_of_a_signature_does_not_pass(tmp_path_factory, data):
    run = tmp_path_factory.mktemp("signed")
    (run / "panel.json").write_text("{}")
    seal(run)
    key = _written(run / "key", ed25519.Ed25519PrivateKey.from_private_bytes(bytes(32)))
    signature = sign(run, read_key(key))
    content = bytearray((run / SIGNATURE_FILE).read_bytes())
    place = data.draw(st.integers(0, len(content) - 2))
    change = data.draw(st.integers(1, 255))
    content[place] ^= change
    (run / SIGNATURE_FILE).write_bytes(content)
    try:
        same = read_signature(run) == signature  # a line may end otherwise
    except EvidenceError:
        return
    assert (_found(run, key) == []) == same


def test_a_key_that_cannot_sign_is_refused(tmp_path, run, key, monkeypatch):
    (tmp_path / "text").write_text("no key")
    curve = _written(tmp_path / "curve", ec.generate_private_key(ec.SECP256R1()))
    for path in (tmp_path / "text", curve, key.with_suffix(".pub")):
        with pytest.raises(EvidenceError, match=r"make one with ssh-keygen -t ed25519"):
            read_key(path)
    with pytest.raises(EvidenceError, match="No such file"):
        read_key(tmp_path / "none")
    with pytest.raises(EvidenceError, match="no public key of kind ssh-ed25519"):
        _found(run, curve)


@pytest.mark.parametrize("content", [b"", b"\n", b"\0" * 9, b"ssh-ed25519", b"\xff" * 99])
def test_files_that_hold_nothing_of_the_kind_are_refused(tmp_path, run, key, content):
    empty = tmp_path / "empty"
    empty.write_bytes(content)
    with pytest.raises(EvidenceError, match="no private key that can sign"):
        read_key(empty)
    with pytest.raises(EvidenceError, match="no public key of kind ssh-ed25519"):
        list(broken_signature(run, empty))
    sign(run, read_key(key))
    blob = base64.b64encode(b"SSHSIG\0\0\0\1" + content).decode()
    begin, end = (f"-----{word} SSH SIGNATURE-----" for word in ("BEGIN", "END"))
    for text in (content, f"{begin}\n{blob}\n{end}\n".encode(), _keyless(begin, end)):
        (run / SIGNATURE_FILE).write_bytes(text)
        with pytest.raises(EvidenceError, match=r"is no signature of a seal: .*sign it again"):
            read_signature(run)


def _keyless(begin, end):
    """A signature whose key is empty."""
    parts = (b"", b"integ-gym", b"", b"sha512", b"\0\0\0\x0bssh-ed25519\0\0\0\1x")
    body = b"".join(len(part).to_bytes(4, "big") + part for part in parts)
    blob = base64.b64encode(b"SSHSIG\0\0\0\1" + body).decode()
    return f"{begin}\n{blob}\n{end}\n".encode()


def test_a_passphrase_is_asked_for(tmp_path, run, monkeypatch):
    path = _written(tmp_path / "locked", ed25519.Ed25519PrivateKey.generate(), b"secret")
    with pytest.raises(EvidenceError, match="has a passphrase, which is asked for on a terminal"):
        read_key(path)
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    for word, fits in (("secret", True), ("wrong", False)):
        monkeypatch.setattr("getpass.getpass", lambda _, word=word: word)
        if fits:
            sign(run, read_key(path))
        else:
            with pytest.raises(EvidenceError, match="no private key that can sign"):
                read_key(path)
    assert _found(run, path) == []


def test_the_command_seals_signs_and_verifies(store, key, capsys):
    run = str(store.directory)
    public = str(key.with_suffix(".pub"))
    assert main(["evidence", "verify", run, "--public-key", public]) == 2
    assert "has no seal.json" in capsys.readouterr().err
    assert main(["evidence", "seal", run]) == 0
    printed = capsys.readouterr().out
    assert main(["evidence", "verify", run, "--public-key", public]) == 1
    assert "is missing: the seal is not signed" in capsys.readouterr().out
    assert main(["evidence", "seal", run, "--sign", str(key)]) == 0
    signed = capsys.readouterr().out
    assert signed.startswith(printed)
    fingerprint = signed.split()[-1]
    assert main(["evidence", "verify", run]) == 0
    assert f"signed: by {fingerprint}, not checked" in capsys.readouterr().out
    assert main(["evidence", "verify", run, "--public-key", public]) == 0
    assert f"signed: by {fingerprint}, of {public}" in capsys.readouterr().out
    (store.directory / "note.json").write_text("{}")
    assert main(["evidence", "seal", run]) == 2
    assert "has a seal that does not hold: note.json: is not of the" in capsys.readouterr().err
