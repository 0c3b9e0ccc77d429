"""Policies in NumPy act as SB3's own prediction does."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import example, given, settings
from hypothesis import strategies as st
from policy_files import UNIT_3, BoxEnv, read_or_none, refusal, rewritten

from integ_gym.train.policy import ACTIVATIONS, BoxActions, DiscreteActions
from integ_gym.train.policy_files.sb3_zip import read_sb3_zip

torch = pytest.importorskip("torch")
sb3 = pytest.importorskip("stable_baselines3")
vec_env = pytest.importorskip("stable_baselines3.common.vec_env")

nn = torch.nn

# (environment, whether gSDE is used, policy_kwargs)
TRAINED: dict[str, tuple[str, bool, dict[str, Any]]] = {
    "pendulum-defaults": ("Pendulum-v1", False, {}),
    "pendulum-relu": ("Pendulum-v1", False, {"activation_fn": nn.ReLU}),
    "pendulum-unequal": (
        "Pendulum-v1",
        False,
        {"net_arch": {"pi": [32, 16], "vf": [64]}, "activation_fn": nn.ELU, "ortho_init": False},
    ),
    "pendulum-linear": ("Pendulum-v1", False, {"net_arch": []}),
    "pendulum-gsde": ("Pendulum-v1", True, {"use_expln": True, "full_std": False}),
    "pendulum-gsde-squashed": (
        "Pendulum-v1",
        True,
        {"squash_output": True, "net_arch": [32], "share_features_extractor": False},
    ),
    "cartpole-defaults": ("CartPole-v1", False, {}),
    "cartpole-relu": ("CartPole-v1", False, {"activation_fn": nn.ReLU, "net_arch": [16, 8, 8]}),
}


@pytest.fixture(scope="session", autouse=True)
def one_torch_thread() -> Iterator[None]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def train(env: Any, use_sde: bool = False, policy_kwargs: dict[str, Any] | None = None) -> Any:
    """A PPO model after 2048 steps, far enough from its initial weights to matter."""
    model = sb3.PPO(
        "MlpPolicy",
        env,
        use_sde=use_sde,
        policy_kwargs=policy_kwargs,
        n_steps=512,
        n_epochs=4,
        learning_rate=3e-3,
        seed=7,
        device="cpu",
    )
    return model.learn(2048)


@pytest.fixture(scope="session", params=TRAINED)
def trained(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Zip of a trained policy, one per configuration."""
    env, use_sde, policy_kwargs = TRAINED[request.param]
    path = tmp_path_factory.mktemp("trained") / f"{request.param}.zip"
    train(env, use_sde, dict(policy_kwargs)).save(path)
    return path


@pytest.fixture(scope="session")
def normalized(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Any]:
    """Zip of a policy trained inside VecNormalize, JSON of its statistics, the wrapper."""
    folder = tmp_path_factory.mktemp("normalized")
    env = vec_env.VecNormalize(
        vec_env.DummyVecEnv([lambda: gym.make("Pendulum-v1")]), clip_obs=1.5, epsilon=1e-6
    )
    train(env).save(folder / "model.zip")
    statistics = {
        "mean": env.obs_rms.mean.tolist(),
        "var": env.obs_rms.var.tolist(),
        "epsilon": env.epsilon,
        "clip_obs": env.clip_obs,
    }
    (folder / "statistics.json").write_text(json.dumps(statistics))
    return folder / "model.zip", folder / "statistics.json", env


def observations_near_and_far(dim: int, n: int = 200) -> np.ndarray:
    """Observations whose size grows from 0.1 to 1000, float32, shape (n, dim)."""
    sizes = np.geomspace(0.1, 1e3, n)[:, None]
    return (np.random.default_rng(3).normal(size=(n, dim)) * sizes).astype(np.float32)


def rounding(observations: np.ndarray) -> np.ndarray:
    """What float32 sums in another order may differ by: 1e-5, more for far ones; shape (n, 1)."""
    return 1e-5 * np.maximum(1.0, np.abs(observations).max(axis=1, keepdims=True) / 10.0)


def assert_close(actual: np.ndarray, expected: np.ndarray, observations: np.ndarray) -> None:
    """Actions of shape (n, action_dim) agree up to `rounding`."""
    worst = np.abs(actual - expected) / rounding(observations)
    assert worst.max() < 1.0


def test_trained_policy_acts_as_sb3_predicts(trained: Path) -> None:
    model = sb3.PPO.load(trained, device="cpu")
    policy = read_sb3_zip(trained)
    observations = observations_near_and_far(policy.observation_shape[0])
    expected, _ = model.predict(observations, deterministic=True)
    actions = policy.act(observations)
    assert actions.shape == expected.shape
    assert actions.dtype == expected.dtype
    assert np.unique(actions).size > 1, "a constant policy would prove nothing"
    if isinstance(policy.actions, DiscreteActions):
        logits = np.sort(policy.outputs(observations), axis=1)
        decided = logits[:, -1] - logits[:, -2] > 10 * rounding(observations)[:, 0]
        assert decided.mean() > 0.95
        np.testing.assert_array_equal(actions[decided], expected[decided])
    else:
        assert_close(actions, expected, observations)


def test_trained_policy_fits_its_environment(trained: Path) -> None:
    policy = read_sb3_zip(trained)
    env_id, use_sde, policy_kwargs = TRAINED[trained.stem]
    env = gym.make(env_id)
    policy.check_spaces(env.observation_space, env.action_space)
    assert policy.policy_id == trained.stem
    assert policy.actions.space == env.action_space
    if isinstance(policy.actions, BoxActions):
        assert policy.actions.squash == bool(use_sde and policy_kwargs.get("squash_output"))


def test_statistics_act_as_vec_normalize_does(normalized: tuple[Path, Path, Any]) -> None:
    path, statistics, wrapper = normalized
    policy = read_sb3_zip(path, statistics)
    observations = observations_near_and_far(3)
    model = sb3.PPO.load(path, device="cpu")
    expected, _ = model.predict(wrapper.normalize_obs(observations), deterministic=True)
    assert_close(policy.act(observations), expected, observations)
    bare = read_sb3_zip(path)
    assert np.abs(bare.act(observations) - expected).max() > 0.01
    assert bare.content_hash != policy.content_hash


def test_a2c_is_read_too(scratch: Path) -> None:
    model = sb3.A2C("MlpPolicy", "Pendulum-v1", device="cpu", seed=2)
    model.save(scratch / "a2c.zip")
    observations = observations_near_and_far(3)
    expected, _ = model.predict(observations, deterministic=True)
    actions = read_sb3_zip(scratch / "a2c.zip").act(observations)
    assert_close(actions, expected, observations)


@pytest.mark.parametrize("name", ACTIVATIONS)
def test_activation_is_the_one_that_sb3_saves(name: str, pendulum_zip: Path, scratch: Path) -> None:
    model = sb3.PPO(
        "MlpPolicy", "Pendulum-v1", device="cpu", policy_kwargs={"activation_fn": getattr(nn, name)}
    )
    model.save(scratch / "activation.zip")
    policy = read_sb3_zip(scratch / "activation.zip")
    assert policy.activation == name
    observations = observations_near_and_far(3)
    expected, _ = model.predict(observations, deterministic=True)
    assert_close(policy.act(observations), expected, observations)


@pytest.mark.parametrize("name", ACTIVATIONS)
def test_activation_equals_torch(name: str) -> None:
    values = np.concatenate([np.linspace(-30, 30, 2001), [-1e30, -1e4, 0.0, 1e4, 1e30]])
    x = values.astype(np.float32)
    actual = ACTIVATIONS[name](x)
    assert actual.dtype == np.float32
    np.testing.assert_allclose(
        actual, getattr(nn, name)()(torch.tensor(x)).numpy(), rtol=1e-5, atol=1e-6
    )


@pytest.mark.parametrize("squash", [False, True])
def test_uneven_bounds_survive_their_printed_form(squash: bool, scratch: Path) -> None:
    low = np.array([-1.0, -1 / 3, -8.0], dtype=np.float32)
    high = np.array([1e-7, 2.0, 1e6], dtype=np.float32)
    env = BoxEnv(UNIT_3, spaces.Box(low, high))
    model = sb3.PPO(
        "MlpPolicy", env, device="cpu", use_sde=squash, policy_kwargs={"squash_output": squash}
    )
    model.save(scratch / "uneven.zip")
    policy = read_sb3_zip(scratch / "uneven.zip")
    assert isinstance(policy.actions, BoxActions)
    np.testing.assert_array_equal(policy.actions.low, low)
    np.testing.assert_array_equal(policy.actions.high, high)
    observations = observations_near_and_far(3)
    expected, _ = model.predict(observations, deterministic=True)
    assert_close(policy.act(observations) / high.max(), expected / high.max(), observations)
    near = observations[:60]
    np.testing.assert_allclose(policy.act(near)[:, :2], expected[:60, :2], rtol=0, atol=1e-5)


@given(st.floats(0, 1e9, width=32))
@example(0.41887903213500977)
@example(0.0833333358168602)
@example(0.05)
@settings(deadline=None, max_examples=60)
def test_a_printed_bound_is_exact_or_refused(
    pendulum_zip: Path, scratch: Path, value: float
) -> None:
    high = np.array([value], dtype=np.float32)

    def print_bounds(data: dict[str, Any]) -> None:
        data["action_space"] |= {"high": str(high), "low": str(-high)}

    path = rewritten(pendulum_zip, scratch / "printed.zip", print_bounds)
    if 0 < value < 0.125 and read_or_none(path) is None:
        assert "may be rounded; pass action_bounds" in refusal(path)
        return
    actions = read_sb3_zip(path).actions
    assert isinstance(actions, BoxActions)
    if value == 0 or value >= 0.125:
        np.testing.assert_array_equal(actions.high, high)
    np.testing.assert_allclose(actions.high, high, rtol=0, atol=5e-9)
    np.testing.assert_array_equal(actions.low, -actions.high)


def test_action_bounds_replace_the_printed_ones(scratch: Path) -> None:
    high = np.linspace(1.0, 2.0, 1200, dtype=np.float32)
    env = BoxEnv(UNIT_3, spaces.Box(-high, high))
    sb3.PPO("MlpPolicy", env, device="cpu").save(scratch / "many.zip")
    assert "does not spell out 1200 numbers; pass action_bounds" in refusal(scratch / "many.zip")
    policy = read_sb3_zip(scratch / "many.zip", action_bounds=(-high, high))
    assert policy.actions.space == env.action_space
    message = refusal(scratch / "many.zip", action_bounds=([-1.0, -1.0], [1.0, 1.0]))
    assert "action_bounds have length 2 and the action space 1200" in message
