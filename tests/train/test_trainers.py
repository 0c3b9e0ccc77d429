"""Both trainers have one door: what they are given, what they tell, and the script."""

from __future__ import annotations

import runpy
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from small_ppo import FLAGS, SMALL, files_of

import integ_gym
from integ_gym.evidence.labels import EpisodeContext
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.config import TrainingError, TrainingEvidence
from integ_gym.train.fleet.training import train_fleet
from integ_gym.train.policy_files.sidecar import TrainedPolicy, read_sidecar, read_trained
from integ_gym.train.runs import train_ppo

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

OWN = {
    train_ppo: {"tensorboard"},
    train_fleet: {"memory_gib", "cache_dir", "together"},
}
"""What one trainer alone is told."""
SCRIPT = Path(integ_gym.__file__).parent.parent / "train" / "ppo.py"


@pytest.mark.slow
@pytest.mark.parametrize("train", OWN)
def test_both_trainers_write_record_and_tell(train, small, tmp_path):
    """Several policies at once, in processes: each as if it were alone."""
    configs = [SMALL, replace(SMALL, seed=4, trace_every=1)]
    folders = [tmp_path / "three", tmp_path / "four"]
    evidence = []
    for config, name in zip(configs, ("three", "four"), strict=True):
        context = EpisodeContext("run", name, phase="training", trace_every=config.trace_every)
        evidence.append(TrainingEvidence(tmp_path / "evidence", name, context))
    told: dict[int, TrainedPolicy] = {}
    options: dict[str, Any] = {"tensorboard": False} if train is train_ppo else {}
    options |= {"evidence": evidence, "on_trained": told.__setitem__}
    policies = train(configs, folders, progress=False, workers=2, **options)
    assert [told[0], told[1]] == policies
    assert [policy.card["seed"] for policy in policies] == [3, 4]
    for policy, folder in zip(policies, folders, strict=True):
        assert policy.policy.parent == folder
        assert read_trained(policy.policy)[0].content_hash == policy.content_hash
    if train is train_ppo:
        assert policies[0].content_hash == small.content_hash
    store = EvidenceStore(tmp_path / "evidence")
    assert store.verify() == []
    traced = [(r["cell"], bool(r.trace)) for r in store.records()]
    assert sorted(traced) == [("four", True)] * 8 + [("three", False)] * 7 + [("three", True)]


@pytest.mark.parametrize("train", OWN)
def test_folders_are_checked_before_anything_is_trained(train, tmp_path):
    (tmp_path / "held").mkdir()
    (tmp_path / "held" / "policy.zip").write_text("")
    with pytest.raises(ValueError, match=r"one entry per configuration \(2\), got 1 and none"):
        train([SMALL, SMALL], [tmp_path])
    with pytest.raises(ValueError, match=r"one entry per configuration \(1\), got 1 and 0"):
        train([SMALL], [tmp_path], evidence=[])
    with pytest.raises(FileExistsError, match="--force"):
        train([SMALL, SMALL], [tmp_path / "free", tmp_path / "held"])
    assert not (tmp_path / "free").exists()
    assert train([], []) == []


def test_a_run_that_fails_in_a_process_is_told(tmp_path):
    broken = replace(SMALL, learning_rate=1e6)
    with pytest.raises(TrainingError, match=r"training failed: .*lower `learning_rate`=1e\+06; f"):
        train_ppo([broken, broken], [tmp_path / "a", tmp_path / "b"], progress=False, workers=2)
    assert all("tensorboard" in name for name in files_of(tmp_path))


def test_the_script_writes_what_the_command_writes(small, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", [str(SCRIPT), *FLAGS, "--dt", "0.05"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(SCRIPT), run_name="__main__")
    assert not ended.value.code
    folder = tmp_path / "runs" / "IntegPendulum-v0-rk4-0.05-seed3"
    assert read_sidecar(folder / "policy.zip")["content_hash"] == small.content_hash
    names = {Path(name).parts[0] for name in files_of(folder)}
    assert names == {Path(name).parts[0] for name in files_of(small.policy.parent)}
    assert "PPO, 1 policy: 100%" in capsys.readouterr().err
