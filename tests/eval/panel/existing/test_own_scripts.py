"""Policies of a user's own scripts of stable-baselines3, judged in one line each."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import A2C
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecNormalize

from integ_gym.cli import main
from integ_gym.evidence.fields import VOLATILE_NAMES
from integ_gym.evidence.store import EvidenceStore

PENDULUM = "IntegPendulum-v0"
SMALL = ["--episodes", "3", "--env-arg", "duration=2.0", "--workers", "1", "--no-progress"]
NAMING = {"record_id", "policy_hash", "content_hash", "run_id"}
"""What says which policy and which run it is; all else is what the policy did."""

OFF_POLICY = """
from stable_baselines3 import SAC

from integ_gym import save_policy

model = SAC("MlpPolicy", "Pendulum-v1", seed=0, learning_starts=50, device="cpu",
    policy_kwargs=dict(net_arch=[32, 32]))
model.learn(150)
model.save("zip/own.zip")
for ending in ("safetensors", "onnx"):
    save_policy("zip/own.zip", f"{ending}/own.{ending}", "IntegPendulum-v0", home="stock")
"""

ON_EXPLICIT_EULER = """
import gymnasium as gym
import integ_gym  # registers the environments
from stable_baselines3 import PPO

env = gym.make("IntegPendulum-v0", integrator="explicit_euler", dt=0.05)
model = PPO("MlpPolicy", env, n_steps=64, batch_size=64, n_epochs=1, seed=0, device="cpu")
model.learn(64)
model.save("own.zip")
"""


def _run(script: str, folder: Path) -> None:
    (folder / "own.py").write_text(script)
    done = subprocess.run(
        [sys.executable, "own.py"], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def _evaluate(policy: Path, out: Path, *more: str) -> EvidenceStore:
    command = ["evaluate", str(policy), "--env", PENDULUM, "--out", str(out), *SMALL, *more]
    assert main(command) == 0
    return EvidenceStore(out / "evidence")


def _own(store: EvidenceStore) -> list:
    evaluated = [record for record in store.records() if record["phase"] == "evaluation"]
    records = [record for record in evaluated if record["policy_id"] == "own"]
    return sorted(records, key=lambda record: (record["cell"], record["episode_index"]))


@pytest.mark.slow
def test_one_policy_in_three_files_gives_equal_records(tmp_path):
    """But for its hash; onnxruntime's actions are equal within float32."""
    for ending in ("zip", "safetensors", "onnx"):
        (tmp_path / ending).mkdir()
    _run(OFF_POLICY, tmp_path)
    chosen = ("--home", "stock", "--integrator", "rk4", "--dt", "0.05")
    found = [
        _own(_evaluate(tmp_path / ending / f"own.{ending}", tmp_path / ending / "out", *chosen))
        for ending in ("zip", "safetensors", "onnx")
    ]
    assert len(found[0]) == 3 * len({record["cell"] for record in found[0]}) > 6
    for one, same, of_graph in zip(*found, strict=True):
        for name in one.fields.keys() - VOLATILE_NAMES - NAMING:
            assert one[name] == same[name], name
        assert one.trace.keys() == same.trace.keys() == of_graph.trace.keys()
        for name, values in one.trace.items():
            np.testing.assert_array_equal(values, same.trace[name], err_msg=name)
        assert of_graph["success"] == one["success"]
        assert of_graph["return"] == pytest.approx(one["return"], rel=1e-3)
    assert any(record.trace for record in found[0])
    torques = np.concatenate([record["torque_applied"] for record in found[0] if record.trace])
    assert np.ptp(torques) > 0.0


HOME = ("--home", "integrator=explicit_euler,dt=0.05")
CELLS = ("--integrator", "explicit_euler", "--integrator", "rk4", "--dt", "0.05")


@pytest.mark.slow
def test_a_stated_home_stands_in_the_records(tmp_path, capsys):
    _run(ON_EXPLICIT_EULER, tmp_path)
    records = _own(_evaluate(tmp_path / "own.zip", tmp_path / "out", *CELLS, *HOME))
    stated = {
        "engine": "native",
        "integrator": "explicit_euler",
        "dt": 0.05,
        "control_period": 0.05,
    }
    for record in records:
        assert json.loads(record["training_discretization"]) == stated
        assert record.arguments()["max_speed"] is None
    told = "home: explicit_euler dt=0.05, control period 0.05 s (stated)"
    printed = capsys.readouterr()
    assert printed.err.startswith(told)
    assert printed.out.startswith(("Success at home ", "Mean return at home "))
    assert _panel(tmp_path / "out")["rows"][0]["home"] == "explicit_euler dt=0.05"


def _panel(out: Path) -> dict:
    panel: dict = json.loads((out / "panel.json").read_text(encoding="utf-8"))
    return panel


@pytest.mark.slow
def test_statistics_of_vecnormalize_are_what_the_policy_acts_by(tmp_path):
    """At home its returns are those that stable-baselines3 gets in Gymnasium's own environment."""
    env = VecNormalize(make_vec_env("Pendulum-v1", 1, seed=0))
    model = A2C("MlpPolicy", env, n_steps=64, seed=0, device="cpu")
    model.learn(512)
    model.save(tmp_path / "own.zip")
    env.save(str(tmp_path / "vecnormalize.pkl"))
    chosen = ("--home", "stock", "--integrator", "symplectic_euler", "--dt", "0.05")
    returns = {}
    for name, more in (
        ("with", ("--obs-stats", str(tmp_path / "vecnormalize.pkl"))),
        ("without", ()),
    ):
        store = _evaluate(tmp_path / "own.zip", tmp_path / name, *chosen, *more)
        at_home = [r for r in _own(store) if r["cell"] == "symplectic_euler dt=0.05"]
        returns[name] = {record["seed"]: record["return"] for record in at_home}
    for seed, found in returns["with"].items():
        stock, total = gym.make("Pendulum-v1", max_episode_steps=40), 0.0
        observation, _ = stock.reset(seed=seed)
        for _ in range(40):
            action, _ = model.predict(env.normalize_obs(observation), deterministic=True)
            observation, reward, *_ = stock.step(action)
            total += float(reward)
        assert found == pytest.approx(total, rel=1e-4)
        assert returns["without"][seed] != pytest.approx(total, rel=1e-2)
    kept = tmp_path / "with" / "policies" / "own" / "obs_stats.pkl"
    assert kept.read_bytes() == (tmp_path / "vecnormalize.pkl").read_bytes()
