"""A model that learned inside VecNormalize is told from one that did not, and not judged silently.

Nothing of a file is executed for it.
"""

from __future__ import annotations

import base64
import json
import os
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import TransformObservation
from policy_files import rewritten, setting
from stable_baselines3 import DQN, PPO, SAC
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import integ_gym
from integ_gym.eval.panel.doubts import _unscaled
from integ_gym.eval.panel.policies import read_existing
from integ_gym.train.policy_files.card import PolicyFileError
from integ_gym.train.policy_files.reading import unscaled
from integ_gym.train.policy_files.sidecar import read_trained
from integ_gym.train.policy_files.writing import save_policy, write_sidecar

PENDULUM, HOME = "IntegPendulum-v0", "stock"
SMALL = {
    PPO: {"n_steps": 16, "batch_size": 16, "n_epochs": 1},
    SAC: {"learning_starts": 100, "buffer_size": 50},
    DQN: {"learning_starts": 100, "buffer_size": 50},
}


def _environment(dtype, discrete):
    env = gym.make("CartPole-v1" if discrete else "Pendulum-v1")
    seen = env.observation_space
    space = gym.spaces.Box(seen.low.astype(dtype), seen.high.astype(dtype), dtype=np.dtype(dtype))
    return TransformObservation(env, lambda observation: observation.astype(dtype), space)


def _trained(algorithm, scale, folder, dtype="float32"):
    """A model, saved as `policy.zip` with its `vecnormalize.pkl`.

    Args:
        algorithm: its class.
        scale: `norm_obs` of its `VecNormalize`; None: without one.
        folder: for the files.
        dtype: of the environment's observations.
    """
    env = DummyVecEnv([lambda: _environment(dtype, algorithm is DQN)])
    if scale is not None:
        env = VecNormalize(env, norm_obs=scale)
        env.save(folder / "vecnormalize.pkl")
    model = algorithm("MlpPolicy", env, seed=0, device="cpu", **SMALL[algorithm])
    model.learn(16)
    model.save(folder / "policy.zip")
    return model


@pytest.mark.parametrize(
    ("algorithm", "scale", "dtype", "found"),
    [
        (PPO, None, "float32", False),
        (PPO, True, "float32", True),
        (PPO, False, "float32", True),  # of which its vecnormalize.pkl can say that it is not
        (PPO, None, "float64", False),
        (PPO, True, "float64", True),
        (SAC, True, "float32", False),  # which does not show
        (SAC, False, "float64", False),
        (DQN, True, "float64", True),
    ],
)
def test_what_a_file_shows_of_scaling(algorithm, scale, dtype, found, tmp_path):
    _trained(algorithm, scale, tmp_path, dtype)
    assert unscaled(tmp_path / "policy.zip") == found


class _Bomb:
    def __reduce__(self):
        return os.mkdir, ("run",)


def _pickled(value):
    return {":type:": "x", ":serialized:": base64.b64encode(pickle.dumps(value)).decode()}


@pytest.mark.parametrize(
    "seen",
    [3, {}, {":serialized:": "é"}, {":serialized:": "gAR9"}, _pickled(_Bomb()), _pickled([1.0])],
)
def test_what_was_seen_last_is_never_executed(seen, pendulum_zip, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = rewritten(pendulum_zip, tmp_path / "x.zip", setting("_last_original_obs", to=seen))
    assert unscaled(path)
    assert not (tmp_path / "run").exists()


def test_without_statistics_no_side_car_and_no_copy_is_written(tmp_path):
    model = _trained(PPO, True, tmp_path)
    policy, statistics = tmp_path / "policy.zip", tmp_path / "vecnormalize.pkl"
    with pytest.raises(PolicyFileError, match=r'pass obs_stats="vecnormalize\.pkl"'):
        write_sidecar(policy, PENDULUM, home=HOME)
    copy = tmp_path / "copy.safetensors"
    with pytest.raises(PolicyFileError, match=r'pass obs_stats="vecnormalize\.pkl"'):
        save_policy(policy, copy, PENDULUM, home=HOME)
    with pytest.raises(PolicyFileError, match=r"load it with env=VecNormalize\.load"):
        save_policy(PPO.load(policy), copy, PENDULUM, home=HOME)
    assert {path.name for path in tmp_path.iterdir()} == {policy.name, statistics.name}
    save_policy(model, copy, PENDULUM, home=HOME)
    save_policy(policy, copy, PENDULUM, home=HOME, obs_stats=statistics)
    write_sidecar(policy, PENDULUM, home=HOME, obs_stats=statistics)
    assert not unscaled(policy, read_trained(policy)[1])
    save_policy(policy, tmp_path / "again.safetensors", PENDULUM, home=HOME)


def test_an_evaluation_without_statistics_says_so(tmp_path):
    _trained(PPO, True, tmp_path)
    policy, statistics = tmp_path / "policy.zip", tmp_path / "vecnormalize.pkl"
    said: list[str] = []
    integ_gym.evaluate(
        PPO.load(policy), PENDULUM, tmp_path / "out", home=HOME, integrators=["rk4"], dts=[0.05],
        episodes=2, environment={"duration": 0.5}, workers=1, progress=False, on_doubt=said.append,
    )  # fmt: skip
    (doubt,) = [one for one in said if "trained inside VecNormalize" in one]
    assert "load it with env=VecNormalize.load(path, venv)" in doubt
    assert json.loads((tmp_path / "out" / "panel.json").read_text("utf-8"))["doubts"] == said
    assert doubt[:40] in (tmp_path / "out" / "report.html").read_text("utf-8")
    (doubt,) = _unscaled(read_existing(policy, PENDULUM, {}))
    assert "pass --obs-stats vecnormalize.pkl" in doubt
    assert not read_existing(policy, PENDULUM, {}, statistics).unscaled
    _trained(PPO, False, tmp_path)
    assert not read_existing(policy, PENDULUM, {}, statistics).unscaled
    write_sidecar(policy, PENDULUM, home=HOME, obs_stats=statistics)
    assert not unscaled(policy, read_trained(policy)[1])
