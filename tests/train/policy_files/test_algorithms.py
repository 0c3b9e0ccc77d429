"""Every algorithm's file is read as its library acts, in the layouts of old and new versions."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sb3_contrib
import stable_baselines3 as sb3
import torch
from policy_files import refusal, rewritten, saved, state_dict

from integ_gym.train.policy_files.card import PolicyFileError
from integ_gym.train.policy_files.sb3_zip import read_sb3_model, read_sb3_zip

SMALL = {"net_arch": [16, 8]}
REPLAY = {"buffer_size": 10, "policy_kwargs": SMALL}
ALGORITHMS: dict[str, tuple[Any, str, dict[str, Any]]] = {
    "PPO": (sb3.PPO, "Pendulum-v1", {}),
    "A2C": (sb3.A2C, "CartPole-v1", {}),
    "SAC": (sb3.SAC, "Pendulum-v1", REPLAY),
    "SAC with gSDE": (
        sb3.SAC, "Pendulum-v1",
        {"buffer_size": 10, "use_sde": True, "policy_kwargs": {**SMALL, "clip_mean": 0.03}},
    ),
    "SAC with nets apart": (
        sb3.SAC, "Pendulum-v1",
        {"buffer_size": 10, "policy_kwargs": {"net_arch": {"pi": [8], "qf": [4]}}},
    ),
    "TD3": (sb3.TD3, "Pendulum-v1", REPLAY),
    "DDPG": (sb3.DDPG, "Pendulum-v1", REPLAY),
    "DQN": (sb3.DQN, "CartPole-v1", REPLAY),
    "TQC": (sb3_contrib.TQC, "Pendulum-v1", REPLAY),
    "TRPO": (sb3_contrib.TRPO, "Pendulum-v1", {}),
    "QR-DQN": (
        sb3_contrib.QRDQN, "CartPole-v1",
        {"buffer_size": 10, "policy_kwargs": {**SMALL, "n_quantiles": 7}},
    ),
}  # fmt: skip


def _saved(name: str, folder: Path) -> tuple[Any, Path]:
    algorithm, env_id, arguments = ALGORITHMS[name]
    model = algorithm("MlpPolicy", env_id, seed=0, device="cpu", **deepcopy(arguments))
    model.save(folder / "model.zip")
    return model, folder / "model.zip"


def _under_gym(data: dict[str, Any]) -> None:
    """As files were written under gym: other modules, and `shape` in place of `_shape`."""
    for name in ("observation_space", "action_space"):
        space = data[name]
        space[":type:"] = space[":type:"].replace("gymnasium.", "gym.")
        space["shape"] = space.pop("_shape")
        for later in ("start", "low_repr", "high_repr"):
            space.pop(later, None)
    if "n" in data["action_space"]:
        data["action_space"]["n"] = int(data["action_space"]["n"])


@pytest.mark.parametrize("name", ALGORITHMS)
def test_acts_as_the_model_in_both_layouts(name, tmp_path):
    model, path = _saved(name, tmp_path)
    policy = read_sb3_zip(path)
    observations = np.random.default_rng(0).normal(size=(200, *policy.observation_shape))
    expected, _ = model.predict(observations.astype(np.float32), deterministic=True)
    np.testing.assert_allclose(policy.act(observations.astype(np.float32)), expected, atol=2e-6)
    old = read_sb3_zip(rewritten(path, tmp_path / "old.zip", _under_gym))
    assert old.content_hash == policy.content_hash
    assert read_sb3_model(model, "model").content_hash == policy.content_hash


def test_layers_that_actor_and_critic_shared_before_1_8(tmp_path, pendulum_zip):
    tensors = state_dict(pendulum_zip)
    shared = {
        name.replace("policy_net", "shared_net"): x
        for name, x in tensors.items()
        if "policy_net" in name
    }
    kept = {name: x for name, x in tensors.items() if "mlp_extractor" not in name}
    for arch in ([64, 64], [64, 64, {"vf": [], "pi": []}]):

        def edit(data: dict[str, Any], arch: Any = arch) -> None:
            data["policy_kwargs"]["net_arch"] = arch

        content = saved({**shared, **kept})
        path = rewritten(pendulum_zip, tmp_path / "old.zip", edit, policy__pth=content)
        assert read_sb3_zip(path).content_hash == read_sb3_zip(pendulum_zip).content_hash


def test_a_policy_that_remembers_is_refused_with_the_way_that_works(tmp_path):
    path = tmp_path / "model.zip"
    sb3_contrib.RecurrentPPO("MlpLstmPolicy", "Pendulum-v1", device="cpu").save(path)
    assert "a policy that remembers is not judged here; train with PPO" in refusal(path)


def test_a_model_that_is_not_read_is_refused_by_name():
    kwargs = {"activation_fn": torch.nn.PReLU}
    model = sb3.PPO("MlpPolicy", "Pendulum-v1", device="cpu", policy_kwargs=kwargs)
    with pytest.raises(PolicyFileError, match="the model mine: the activation function"):
        read_sb3_model(model, "mine")
