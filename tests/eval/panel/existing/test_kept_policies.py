"""The policy that a run keeps is the one that its evidence names."""

from __future__ import annotations

import json

import numpy as np
import pytest

from integ_gym.eval.panel.policies import find_policy, hashes_of, read_existing
from integ_gym.train.policy import BoxActions, DiscreteActions, MlpPolicy
from integ_gym.train.policy_files.writing import save_policy

STATISTICS = {"mean": [0.1] * 3, "var": [2.0] * 3, "epsilon": 1e-8, "clip_obs": 10.0}


def _policy(inputs, actions, scale=1.0):
    random = np.random.default_rng(0)
    weight = scale * random.normal(size=(actions.size, inputs))
    return MlpPolicy(((weight, np.zeros(actions.size)),), "Tanh", actions)


TORQUE = BoxActions(np.array([-2.0]), np.array([2.0]))


@pytest.mark.parametrize("ending", [".safetensors", ".onnx"])
@pytest.mark.parametrize(
    ("env_id", "inputs", "actions"),
    [("IntegPendulum-v0", 3, TORQUE), ("IntegCartPole-v0", 4, DiscreteActions(2))],
)
def test_what_is_evaluated_has_a_hash_of_what_is_kept(env_id, inputs, actions, ending, tmp_path):
    path = save_policy(_policy(inputs, actions), tmp_path / f"policy{ending}", env_id, home="stock")
    assert find_policy(tmp_path) == (path, None)
    assert read_existing(path, env_id, {}).policy.content_hash in hashes_of(tmp_path)
    other = save_policy(
        _policy(inputs, actions, 2.0), tmp_path / f"other{ending}", env_id, home="stock"
    )
    assert read_existing(other, env_id, {}).policy.content_hash not in hashes_of(tmp_path)


def test_statistics_are_part_of_what_is_kept(tmp_path):
    path = save_policy(_policy(3, TORQUE), tmp_path / "policy.safetensors", "IntegPendulum-v0",
                       home="stock")  # fmt: skip
    alone = hashes_of(tmp_path)
    statistics = tmp_path / "obs_stats.json"
    statistics.write_text(json.dumps(STATISTICS))
    existing = read_existing(path, "IntegPendulum-v0", {}, statistics)
    assert existing.policy.content_hash in hashes_of(tmp_path) - alone


def test_a_run_of_functions_keeps_no_policy(tmp_path):
    assert find_policy(tmp_path) is None
    assert hashes_of(tmp_path) == set()
