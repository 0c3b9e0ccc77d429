"""Actions in a Box of shape (1, n), as some environments have, in every form of a policy."""

import json

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from stable_baselines3 import PPO, SAC

import integ_gym
from integ_gym.eval.panel.policies import find_policy, given_policy, hashes_of, read_existing
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.policy import BoxActions, DiscreteActions, MlpPolicy
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
