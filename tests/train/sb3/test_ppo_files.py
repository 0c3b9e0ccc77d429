"""A trained policy is there whole, or not at all."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from small_ppo import FLAGS, SMALL, WRITTEN, Recorder, files_of, looked_on, trained

from integ_gym.train.command import training_command as main
from integ_gym.train.policy_files import sidecar
from integ_gym.train.policy_files.card import PolicyFileError, hashed
from integ_gym.train.policy_files.sidecar import TrainedPolicy, read_trained

torch = pytest.importorskip("torch")
sb3 = pytest.importorskip("stable_baselines3")


def test_an_interrupted_run_leaves_no_policy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = looked_on(monkeypatch, lambda env: Recorder(env, fail_at=70))
    assert main([*FLAGS, "--out", str(tmp_path), "--no-tensorboard", "--no-progress"]) == 130
    assert "interrupted; no policy was written" in capsys.readouterr().err
    assert files_of(tmp_path) == set()
    assert made[-1].closed_by_trainer


@pytest.mark.parametrize("replaced_before_the_end", [0, 1])
def test_a_run_killed_while_writing_leaves_no_sidecar(
    replaced_before_the_end: int,
    small: TrainedPolicy,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for path in (small.policy, small.sidecar):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    renamed: list[Any] = []
    replace_file = os.replace

    def killed(source: Any, target: Any) -> None:
        if len(renamed) == replaced_before_the_end:
            raise KeyboardInterrupt
        renamed.append(target)
        replace_file(source, target)

    monkeypatch.setattr(sidecar.os, "replace", killed)
    with pytest.raises(KeyboardInterrupt):
        trained(replace(SMALL, seed=9), tmp_path, force=True)
    assert files_of(tmp_path) == {"policy.zip"}
    with pytest.raises(PolicyFileError, match="keep the side-car beside the policy"):
        read_trained(tmp_path / "policy.zip")


def test_a_policy_is_replaced_only_by_force(small: TrainedPolicy, tmp_path: Path) -> None:
    (tmp_path / "policy.zip").write_bytes(b"something else")
    with pytest.raises(FileExistsError, match=r"already holds policy\.zip; .* or --force"):
        trained(SMALL, tmp_path)
    policy = trained(SMALL, tmp_path, force=True)
    assert policy.content_hash == small.content_hash
    assert files_of(tmp_path) == WRITTEN


def test_a_sidecar_of_another_policy_is_found_out(small: TrainedPolicy, tmp_path: Path) -> None:
    (tmp_path / "policy.zip").write_bytes(small.policy.read_bytes())
    path = tmp_path / "policy.json"
    for text, message in (
        (
            json.dumps(hashed({**small.card, "content_hash": "0" * 64})),
            r"is not the policy that policy\.js",
        ),
        (json.dumps({**small.card, "seed": 9}), "was edited after it was written"),
        (json.dumps({**small.card, "format": "other"}), "has format 'other' where 'integ-gym poli"),
        ("[]", "a list where an object was expected"),
        ("{", "is damaged"),
    ):
        path.write_text(text)
        with pytest.raises(PolicyFileError, match=message):
            read_trained(tmp_path / "policy.zip")
