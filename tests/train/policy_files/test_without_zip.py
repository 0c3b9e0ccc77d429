"""A policy of the fleet without stable-baselines3's zip, and which of two files is read."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from gymnasium import spaces

from integ_gym.train.policy_files.card import PolicyFileError, hashed
from integ_gym.train.policy_files.sidecar import (
    actor_of,
    policy_file,
    read_trained,
    readable_file,
    write_actor,
)
from integ_gym.train.sb3_model import initial_stack, state_dict

TORQUE = spaces.Box(-2.0, 2.0, (1,), np.float32)
CARD = {"policy_id": "mine", "seed": 0}


def _actor(seed: int = 0, space: spaces.Space = TORQUE):
    outputs = 1 if isinstance(space, spaces.Box) else int(space.n)
    noise = [0.0] if isinstance(space, spaces.Box) else None
    weights = state_dict(initial_stack([seed], (3, 8, 4), outputs, noise), 0)
    return actor_of(weights, 2, "Tanh", space)


@pytest.mark.parametrize("space", [TORQUE, spaces.Discrete(2)])
def test_the_side_car_names_the_weights(tmp_path: Path, space):
    actor = _actor(space=space)
    (tmp_path / "policy.zip").write_bytes(b"of a policy that is replaced")
    written = write_actor(tmp_path, actor, CARD, space)
    assert {path.name for path in tmp_path.iterdir()} == {"policy.json", "policy.safetensors"}
    assert written.card["policy_file"] == "policy.safetensors"
    assert written.policy == policy_file(tmp_path) == readable_file(tmp_path)
    read, card = read_trained(written.policy)
    assert read.content_hash == actor.content_hash == card["content_hash"]
    assert read.policy_id == "mine"


def test_weights_that_are_not_finite_are_no_policy():
    weights = state_dict(initial_stack([0], (3, 8, 4), 1, [0.0]), 0)
    weights["action_net.bias"][:] = np.nan
    with pytest.raises(PolicyFileError, match="training left a policy that cannot be used: "):
        actor_of(weights, 2, "Tanh", TORQUE)


def test_the_weights_are_read_where_the_zip_is_the_one_written_with_them(tmp_path: Path):
    write_actor(tmp_path, _actor(), CARD, TORQUE, b"a zip")
    named, weights = tmp_path / "policy.zip", tmp_path / "policy.safetensors"
    assert policy_file(tmp_path) == named
    assert readable_file(tmp_path) == weights
    named.write_bytes(b"another zip")
    assert readable_file(tmp_path) == named
    named.write_bytes(b"a zip")
    weights.unlink()
    assert readable_file(tmp_path) == named


def test_a_side_car_names_no_file_elsewhere(tmp_path: Path):
    card = hashed({"format": "integ-gym policy 2", "policy_file": "../policy.zip"})
    (tmp_path / "policy.json").write_text(json.dumps(card))
    assert policy_file(tmp_path) == tmp_path / "policy.zip"
