"""Policy files are read without executing anything, and without what wrote them."""

from __future__ import annotations

import base64
import pickle
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from policy_files import refusal, rewritten, saved, setting, state_dict

from integ_gym.train.policy_files.sb3_published import zip_faults
from integ_gym.train.policy_files.sb3_zip import read_sb3_zip
from integ_gym.train.policy_files.writing import save_policy


class Touch:
    """Creates a file when unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return (open, (str(self.path), "w"))


@pytest.fixture
def trap(tmp_path: Path) -> Iterator[tuple[Touch, Path]]:
    """An object that creates a file when unpickled, shown to work, and that file, absent."""
    bait = tmp_path / "executed"
    pickle.loads(pickle.dumps(Touch(bait))).close()
    assert bait.exists()
    bait.unlink()
    yield Touch(bait), bait
    assert not bait.exists(), "reading the policy executed code from the file"


def test_pickled_data_is_never_decoded(pendulum_zip: Path, trap: tuple[Touch, Path]) -> None:
    touch, bait = trap
    payload = base64.b64encode(pickle.dumps(touch)).decode()

    def poison(data: dict[str, Any]) -> None:
        for value in data.values():
            if isinstance(value, dict):
                value[":serialized:"] = payload
        data["extra"] = {":type:": "<class 'x'>", ":serialized:": payload}

    evil = rewritten(
        pendulum_zip,
        bait.with_name("evil.zip"),
        poison,
        pytorch_variables__pth=saved(touch),
        policy__optimizer__pth=saved(touch),
    )
    assert read_sb3_zip(evil).content_hash == read_sb3_zip(pendulum_zip).content_hash


def test_pickled_weights_are_never_executed(pendulum_zip: Path, trap: tuple[Touch, Path]) -> None:
    touch, bait = trap
    tensors = state_dict(pendulum_zip)
    for payload in (saved(touch), saved({**tensors, "log_std": touch})):
        evil = rewritten(pendulum_zip, bait.with_name("evil.zip"), policy__pth=payload)
        assert "holds something other than plain weights" in refusal(evil)
    evil = rewritten(pendulum_zip, bait.with_name("evil.zip"), policy__pth=pickle.dumps(touch))
    assert "is no file that torch.save wrote" in refusal(evil)


def test_what_is_put_into_a_published_zip_is_found(
    pendulum_zip: Path, trap: tuple[Touch, Path]
) -> None:
    touch, bait = trap
    weights = bait.with_name("policy.safetensors")
    save_policy(pendulum_zip, weights, "Pendulum-v1", home="stock")
    assert list(zip_faults(pendulum_zip, weights)) == []
    payload = base64.b64encode(pickle.dumps(touch)).decode()
    evil = rewritten(
        pendulum_zip, bait.with_name("evil.zip"), setting("seed", to={":serialized:": payload}),
        policy__optimizer__pth=saved(touch),
    )  # fmt: skip
    faults = list(zip_faults(evil, weights))
    assert [one.split(" when")[0] for one in faults] == [
        "policy.optimizer.pth imports io.open",
        "'seed' of its 'data' imports io.open",
    ]


def test_sb3_is_not_needed(pendulum_zip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    assert read_sb3_zip(pendulum_zip).observation_shape == (3,)


def test_without_torch_one_line_says_what_to_install(
    pendulum_zip: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(ImportError) as caught:
        read_sb3_zip(pendulum_zip)
    assert str(caught.value) == 'torch is not installed; run: pip install -e ".[train]"'
