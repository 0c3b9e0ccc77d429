"""Policies of a user's own scripts of stable-baselines3, judged in one line each."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

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
