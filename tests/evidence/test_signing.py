"""A seal's signature: by whom, of what, made and checked by OpenSSH."""

import base64
import subprocess

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from integ_gym.cli import main
from integ_gym.evidence.schema import EvidenceError
from integ_gym.evidence.sealing import (
    SEAL_FILE,
    SIGNATURE_FILE,
    SIGSTORE_FILE,
    check_key,
    find_broken_seals,
    find_signature_faults,
    read_signer,
    seal,
    sign,
)

EARLIER_SIGNATURE = """\
-----BEGIN SSH SIGNATURE-----
U1NIU0lHAAAAAQAAADMAAAALc3NoLWVkMjU1MTkAAAAgA6EHv/POEL4dcN0Y50vAmWfk1j
CbpQ1fHdyGZBJVMbgAAAAJaW50ZWctZ3ltAAAAAAAAAAZzaGE1MTIAAABTAAAAC3NzaC1l
ZDI1NTE5AAAAQJh3Ql+6YrmxJwaXyVGfe57VHvCqy+Z3KqNNJ9zVeJ45l9E6w+F4A4o0+a
aHjY2bOHL4FNLT6UDQLmM1fJqx5g4=
-----END SSH SIGNATURE-----
"""
"""Made of `EARLIER_SEAL` without OpenSSH, before ssh-keygen was called."""

EARLIER_SEAL = '{"seal": "abc"}\n'
EARLIER_KEY = "ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIAOhB7/zzhC+HXDdGOdLwJln5NYwm6UNXx3chmQSVTG4"


def _make_key(path, kind="ed25519", passphrase=""):
    words = ["ssh-keygen", "-q", "-t", kind, "-N", passphrase, "-f", str(path)]
    subprocess.run(words, check=True)
    return path


@pytest.fixture
def key(tmp_path):
    return _make_key(tmp_path / "key")


@pytest.fixture
def run(tmp_path):
    directory = tmp_path / "run"
    directory.mkdir()
    (directory / "panel.json").write_text('{"rows": []}')
    seal(directory)
    return directory


def _findings(run, key):
    return [
        finding.message for finding in find_signature_faults(run, key and key.with_suffix(".pub"))
    ]


@pytest.mark.parametrize("kind", ["ed25519", "ecdsa", "rsa"])
def test_a_signature_is_by_the_key_and_of_the_seal(run, kind, tmp_path):
    key = _make_key(tmp_path / "key", kind)
    assert _findings(run, None) == []
    assert _findings(run, key) == ["is missing: the seal is not signed"]
    signer = sign(run, key)
    assert _findings(run, key) == _findings(run, None) == []
    assert read_signer(run) == signer
    (found,) = _findings(run, _make_key(tmp_path / "other"))
    assert found.startswith(f"is by {signer}, no key of ")
    (run / SEAL_FILE).write_text((run / SEAL_FILE).read_text() + " ")
    for keys in (key, None):
        (found,) = _findings(run, keys)
        assert found.startswith(f"is no signature of this {SEAL_FILE}: ")
    with pytest.raises(EvidenceError, match="is no signature of this"):
        read_signer(run)


def test_a_signature_goes_with_its_seal(run, key):
    sign(run, key)
    (run / SIGSTORE_FILE).write_text("{}")
    assert list(find_broken_seals(run)) == []
    seal(run)
    assert _findings(run, key) == []
    (run / "panel.json").write_text("{}")
    seal(run)
    assert not (run / SIGNATURE_FILE).exists()
    assert not (run / SIGSTORE_FILE).exists()


def test_a_signature_of_before_still_holds(tmp_path):
    (tmp_path / SEAL_FILE).write_text(EARLIER_SEAL)
    (tmp_path / SIGNATURE_FILE).write_text(EARLIER_SIGNATURE)
    (tmp_path / "key.pub").write_text(EARLIER_KEY)
    assert _findings(tmp_path, tmp_path / "key") == []


@given(data=st.data())
@settings(max_examples=20)
def test_what_a_changed_byte_makes_of_a_signature_does_not_pass(tmp_path_factory, data):
    run = tmp_path_factory.mktemp("signed")
    begin, *lines, end = EARLIER_SIGNATURE.splitlines()
    content = bytearray(base64.b64decode("".join(lines)))
    place, change = data.draw(st.integers(0, len(content) - 1)), data.draw(st.integers(1, 255))
    assume((place, change) != (9, 1))  # ssh-keygen takes version 0 of the format as 1
    content[place] ^= change
    (run / SEAL_FILE).write_text(EARLIER_SEAL)
    text = "\n".join((begin, base64.b64encode(content).decode(), end, ""))
    (run / SIGNATURE_FILE).write_text(text)
    assert _findings(run, None) != []


@pytest.mark.parametrize("content", [b"", b"\0" * 9, b"ssh-ed25519", b"\xff" * 99])
def test_files_that_hold_nothing_of_the_kind_are_refused(tmp_path, run, key, content):
    empty = tmp_path / "empty"
    empty.write_bytes(content)
    with pytest.raises(EvidenceError, match=r"cannot sign: .*; make a key with ssh-keygen"):
        check_key(empty)
    with pytest.raises(EvidenceError, match="holds no public key"):
        list(find_signature_faults(run, empty))
    (run / SIGNATURE_FILE).write_bytes(content)
    assert _findings(run, key) != []


def test_without_ssh_keygen_a_run_is_verified_and_its_signature_not(
    store, key, tmp_path, monkeypatch, capsys
):
    run = str(store.directory)
    assert main(["evidence", "seal", run, "--sign", str(key)]) == 0
    monkeypatch.setenv("PATH", str(tmp_path))
    capsys.readouterr()
    assert main(["evidence", "verify", run]) == 0
    assert "signed: not checked, because ssh-keygen is not installed" in capsys.readouterr().out
    for words in (("verify", run, "--public-key", f"{key}.pub"), ("seal", run, "--sign", str(key))):
        assert main(["evidence", *words]) == 2
        assert "signatures need ssh-keygen, which is not installed" in capsys.readouterr().err


def test_the_command_seals_signs_and_verifies(store, key, capsys):
    run, public = str(store.directory), ("--public-key", f"{key}.pub")

    def told(expected, *words):
        assert main(["evidence", *words]) == expected
        captured = capsys.readouterr()
        return captured.err if expected == 2 else captured.out

    assert "has no seal.json" in told(2, "verify", run, *public)
    printed = told(0, "seal", run)
    assert "is missing: the seal is not signed" in told(1, "verify", run, *public)
    signed = told(0, "seal", run, "--sign", str(key))
    assert signed.startswith(printed)
    fingerprint = signed.split()[-1]
    assert f"signed: by {fingerprint}; --public-key" in told(0, "verify", run)
    assert f"signed: by {fingerprint}, a key of {key}.pub" in told(0, "verify", run, *public)
    (store.directory / "seal.json.sig").write_text("no signature")
    assert "seal.json.sig: is no signature of this seal.json" in told(1, "verify", run)
    (store.directory / "note.json").write_text("{}")
    assert "has a seal that does not hold: note.json: is not of the" in told(2, "seal", run)
