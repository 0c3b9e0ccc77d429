"""Policy files that are damaged, too large, or of other weights are refused."""

from __future__ import annotations

import io
import os
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from policy_files import read_or_none, refusal, rewritten, saved, setting, state_dict

from integ_gym.train.policy_files import card as limits
from integ_gym.train.policy_files.card import PolicyFileError
from integ_gym.train.policy_files.reading import read_weights
from integ_gym.train.policy_files.sb3_zip import read_sb3_zip

torch = pytest.importorskip("torch")


def edited_tensors(name: str, tensor: Any) -> Callable[[dict[str, Any]], object]:
    return lambda tensors: {**tensors, name: tensor}


WRONG_WEIGHTS: list[tuple[Callable[[dict[str, Any]], object], str]] = [
    (lambda tensors: list(tensors.values()), "other than float32 weights"),
    (lambda tensors: {1: torch.zeros(1)}, "other than float32 weights"),
    (edited_tensors("action_net.bias", [0.0]), "other than float32 weights"),
    (edited_tensors("action_net.bias", torch.zeros(1).double()), "other than float32 weights"),
    (edited_tensors("action_net.bias", torch.zeros(1, device="meta")), "other than float32"),
    (edited_tensors("action_net.bias", torch.zeros(1).to_sparse()), "other than float32 weights"),
    (edited_tensors("action_net.bias", torch.zeros(2)), "should have shape (1,) for the saved"),
    (edited_tensors("action_net.bias", torch.tensor([torch.nan])), "so training diverged"),
    (edited_tensors("features_extractor.cnn.0.weight", torch.zeros(1)), "have no place in the"),
    (lambda tensors: {}, "'mlp_extractor.policy_net.0.weight' should have shape (64, 3)"),
]


@pytest.mark.parametrize(("edit", "reason"), WRONG_WEIGHTS)
def test_weights_that_are_not_the_architectures_are_refused(
    edit: Callable[[dict[str, Any]], object], reason: str, pendulum_zip: Path, tmp_path: Path
) -> None:
    content = saved(edit(state_dict(pendulum_zip)))
    assert reason in refusal(rewritten(pendulum_zip, tmp_path / "edited.zip", policy__pth=content))


def test_a_torchscript_program_is_refused(pendulum_zip: Path, tmp_path: Path) -> None:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("archive/constants.pkl", b"")
    content = stream.getvalue()
    path = rewritten(pendulum_zip, tmp_path / "script.zip", policy__pth=content)
    assert "is a TorchScript program, which is never run; export it" in refusal(path)


def _old_format(tensors: object) -> bytes:
    stream = io.BytesIO()
    torch.save(tensors, stream, _use_new_zipfile_serialization=False)
    return stream.getvalue()


def test_weights_in_torchs_older_format_are_read(pendulum_zip: Path, tmp_path: Path) -> None:
    old = _old_format(state_dict(pendulum_zip))
    path = rewritten(pendulum_zip, tmp_path / "old.zip", policy__pth=old)
    assert read_sb3_zip(path).content_hash == read_sb3_zip(pendulum_zip).content_hash


class _Touch:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.path,)


def test_torchs_older_format_executes_nothing_and_takes_no_more_than_the_limit(
    pendulum_zip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bait, path = tmp_path / "touched", tmp_path / "old.zip"
    rewritten(pendulum_zip, path, policy__pth=_old_format({"log_std": _Touch(bait)}))
    assert "holds something other than plain weights" in refusal(path)
    assert not bait.exists()
    old = _old_format(state_dict(pendulum_zip))
    count = (64 * 64).to_bytes(2, "little")
    huge = old.replace(b"M" + count, b"J" + (2**31 - 1).to_bytes(4, "little"))
    assert huge != old
    rewritten(pendulum_zip, path, policy__pth=huge)
    assert "asks for more memory than the limit" in refusal(path)
    for content in (old[:40], old[:-100]):
        rewritten(pendulum_zip, path, policy__pth=content)
        assert refusal(path)


def test_a_path_that_cannot_be_opened_is_refused(tmp_path: Path) -> None:
    assert "cannot be opened (No such file or directory)" in refusal(tmp_path / "none.zip")
    assert "cannot be opened (Is a directory)" in refusal(tmp_path)


def test_a_file_that_is_not_a_model_is_refused(pendulum_zip: Path, tmp_path: Path) -> None:
    path = tmp_path / "model.zip"
    path.write_bytes(b"PK not a zip")
    assert "is not a complete zip file" in refusal(path)
    assert "has no member 'data'" in refusal(rewritten(pendulum_zip, path, data=None))
    assert "has no member 'policy.pth'" in refusal(rewritten(pendulum_zip, path, policy__pth=None))


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"{", "its member 'data' is not readable JSON"),
        (b"\xff", "its member 'data' is not readable JSON"),
        (b"[" * 100_000, "its member 'data' is not readable JSON"),
        (b"[]", "its member 'data' is not a JSON object"),
    ],
    ids=["truncated", "not-utf8", "too-deep", "list"],
)
def test_data_that_is_not_an_object_is_refused(
    content: bytes, reason: str, pendulum_zip: Path, tmp_path: Path
) -> None:
    assert reason in refusal(rewritten(pendulum_zip, tmp_path / "data.zip", data=content))


def test_an_unreadable_member_is_refused(pendulum_zip: Path, tmp_path: Path) -> None:
    content = bytearray(pendulum_zip.read_bytes())
    with zipfile.ZipFile(pendulum_zip) as archive:
        directory = archive.start_dir
    content[directory + 8] |= 1  # the flag of an encrypted member
    path = tmp_path / "encrypted.zip"
    path.write_bytes(content)
    assert "cannot be unpacked (RuntimeError)" in refusal(path)


@given(cut=st.floats(0, 1, exclude_max=True))
@settings(deadline=None, max_examples=40)
def test_a_truncated_file_is_refused(pendulum_zip: Path, scratch: Path, cut: float) -> None:
    content = pendulum_zip.read_bytes()
    path = scratch / "truncated.zip"
    path.write_bytes(content[: int(cut * len(content))])
    assert refusal(path)


@given(where=st.integers(1, 10**9), bit=st.integers(0, 7))
@settings(deadline=None, max_examples=100)
def test_a_flipped_bit_is_refused_or_harmless(
    pendulum_zip: Path, scratch: Path, where: int, bit: int
) -> None:
    content = bytearray(pendulum_zip.read_bytes())
    content[-1 - where % 700] ^= 1 << bit  # the zip directory, which no checksum protects
    content[where % len(content)] ^= 1 << bit
    path = scratch / "flipped.zip"
    path.write_bytes(content)
    policy = read_or_none(path)
    if policy is None:
        assert refusal(path)
    else:
        assert policy.content_hash == read_sb3_zip(pendulum_zip).content_hash


def test_members_above_the_limit_are_refused_unread(
    pendulum_zip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with zipfile.ZipFile(pendulum_zip) as archive:
        weights = archive.getinfo("policy.pth").file_size
        data = archive.getinfo("data").file_size
    monkeypatch.setattr(zipfile.ZipFile, "open", lambda *_: pytest.fail("the bomb was unpacked"))
    monkeypatch.setattr(limits, "MAX_JSON_BYTES", data - 1)
    assert f"'data' of {data} bytes, above the limit of {data - 1}" in refusal(pendulum_zip)
    monkeypatch.undo()
    monkeypatch.setattr(limits, "MAX_WEIGHTS_BYTES", weights - 1)
    assert f"'policy.pth' of {weights} bytes, above the limit of" in refusal(pendulum_zip)


def test_a_member_is_unpacked_no_further_than_it_declares(
    pendulum_zip: Path, tmp_path: Path
) -> None:
    """64 MiB of zeros in 64 KiB, of which both headers say that they are 1000 bytes."""
    bomb, size = tmp_path / "bomb.zip", 64 << 20
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("data", bytes(size))
    told = size.to_bytes(4, "little")
    content = bomb.read_bytes()
    assert content.count(told) == 2
    bomb.write_bytes(content.replace(told, (1000).to_bytes(4, "little")))
    tracemalloc.start()
    try:
        assert "; " in refusal(bomb)
        assert tracemalloc.get_traced_memory()[1] < 16 << 20
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("packed", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_a_member_packed_otherwise_is_refused(packed: int, tmp_path: Path) -> None:
    path = tmp_path / "packed.zip"
    with zipfile.ZipFile(path, "w", packed) as archive:
        archive.writestr("data", bytes(1000))
    assert "packed in a way that model.save(path) does not use" in refusal(path)


def test_what_has_no_end_is_refused(tmp_path: Path) -> None:
    for ending in (".zip", ".pt", ".safetensors", ".onnx", ".pkl"):
        pipe = tmp_path / f"policy{ending}"
        os.mkfifo(pipe)
        card = {"network": {"activation": "Tanh"}}
        with pytest.raises(PolicyFileError, match=r"a device or a pipe|is a pickle"):
            read_weights(pipe, card)
    assert "a device or a pipe" in refusal(Path("/dev/zero"))


def test_weights_that_unpack_above_the_limit_are_refused(
    pendulum_zip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("archive/data.pkl", bytes(10**6))
    path = rewritten(pendulum_zip, tmp_path / "bomb.zip", policy__pth=stream.getvalue())
    monkeypatch.setattr(limits, "MAX_WEIGHTS_BYTES", 10**5)
    assert "unpacks to 1000000 bytes, above the limit of 100000" in refusal(path)


def test_weights_that_are_few_numbers_repeated_often_are_refused(
    pendulum_zip: Path, tmp_path: Path
) -> None:
    wide = 2**20
    tensors = state_dict(pendulum_zip)
    one = torch.zeros(1)
    tensors |= {
        "mlp_extractor.policy_net.0.weight": one.expand(wide, 3),
        "mlp_extractor.policy_net.0.bias": one.expand(wide),
        "mlp_extractor.policy_net.2.weight": one.expand(wide, wide),
        "mlp_extractor.policy_net.2.bias": one.expand(wide),
        "action_net.weight": one.expand(1, wide),
    }
    edit = setting("policy_kwargs", "net_arch", to=[wide, wide])
    path = rewritten(pendulum_zip, tmp_path / "wide.zip", edit, policy__pth=saved(tensors))
    assert "the actor needs more than 268435456 bytes" in refusal(path)
