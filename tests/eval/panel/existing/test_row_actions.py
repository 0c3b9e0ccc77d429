"""Actions in a Box of shape (1, n), as some environments have, in every form of a policy."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from stable_baselines3 import PPO, SAC

import integ_gym
from integ_gym.eval.panel.policies import given_policy
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.policy_files.reading import read_weights
from integ_gym.train.policy_files.writing import save_policy


class Rows(gym.ActionWrapper):
    """The pendulum, of which an action is a row of one number."""

    def __init__(self, env):
        super().__init__(env)
        self.action_space = spaces.Box(-2.0, 2.0, (1, 1), np.float32)

    def action(self, action):
        assert np.shape(action) == (1, 1)
        return np.asarray(action)[0]


class RowPendulum(integ_gym.GymTestbed):
    home = integ_gym.Discretization("symplectic_euler", 0.05, 0.05, "gymnasium")
    choices = ("symplectic_euler",)

    def build(self, discretization, **arguments):
        env = gym.make("Pendulum-v1", max_episode_steps=20, **arguments)
        env.unwrapped.dt = discretization.dt
        return Rows(self.held(env, discretization, rewards="rate"))

    def read(self, env):
        return self.as_applied("symplectic_euler", env.unwrapped.dt, env)


ROWS = f"{__name__}:RowPendulum"


def row(observation):
    return [[-2.0 * float(observation[1])]]


def _models():
    env = Rows(gym.make("Pendulum-v1"))
    return (
        PPO("MlpPolicy", env, n_steps=8, batch_size=8, device="cpu", seed=0),
        SAC("MlpPolicy", env, buffer_size=10, device="cpu", seed=0),
    )


def test_every_form_of_a_policy_gives_rows(tmp_path):
    seen = np.random.default_rng(0).normal(size=(6, 3)).astype(np.float32)
    for model in _models():
        expected = model.predict(seen, deterministic=True)[0].reshape(6, 1)
        model.save(tmp_path / "model.zip")
        for name in ("saved.onnx", "saved.safetensors"):
            save_policy(model, tmp_path / name, ROWS, home=None)
        read = [
            given_policy(model, ROWS, {}).policy,
            *(read_weights(tmp_path / n) for n in ("model.zip", "saved.onnx", "saved.safetensors")),
        ]
        for policy in read:
            np.testing.assert_allclose(policy.act(seen), expected, atol=1e-5)
        assert len({policy.content_hash for policy in read[:2]}) == 1


def test_a_policy_is_judged_where_actions_are_rows(tmp_path):
    given_policy(row, ROWS, {})
    policy = tmp_path / "model.zip"
    _models()[1].save(policy)
    panel = integ_gym.evaluate(
        policy, ROWS, tmp_path / "out", dts=[0.05], episodes=2, workers=1, progress=False,
        on_doubt=lambda doubt: None,
    )  # fmt: skip
    assert {one.name for one in panel.rows} >= {"random", "zero"}
    assert EvidenceStore(tmp_path / "out" / "evidence").verify() == []
