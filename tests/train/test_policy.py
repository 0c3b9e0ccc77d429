"""Policies in NumPy: equal to SB3's own prediction, read without executing anything."""

from __future__ import annotations

import base64
import io
import json
import os
import pickle
import re
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import example, given, settings
from hypothesis import strategies as st

from integ_gym.train import sb3_zip
from integ_gym.train.policy import (
    ACTIVATIONS,
    BoxActions,
    DiscreteActions,
    MlpPolicy,
    ObservationStatistics,
    Policy,
)
from integ_gym.train.sb3_zip import PolicyFileError, read_observation_statistics, read_sb3_zip

torch = pytest.importorskip("torch")
sb3 = pytest.importorskip("stable_baselines3")
vec_env = pytest.importorskip("stable_baselines3.common.vec_env")

nn = torch.nn
TORCH_CLASS = "<class 'torch.nn.modules.activation.{}'>"

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


@pytest.fixture(scope="session")
def pendulum_zip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Zip of an untrained default policy on Pendulum-v1: observations (3,), actions [-2, 2]."""
    path = tmp_path_factory.mktemp("template") / "pendulum.zip"
    sb3.PPO("MlpPolicy", "Pendulum-v1", device="cpu", seed=1).save(path)
    return path


@pytest.fixture(scope="session")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scratch")


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


def rewritten(
    source: Path,
    target: Path,
    edit: Callable[[dict[str, Any]], None] | None = None,
    **members: bytes | None,
) -> Path:
    """A copy of a zip with `data` edited in place, other members replaced, or (None) left out."""
    members = {name.replace("__", "."): content for name, content in members.items()}
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            content = members[name] if name in members else old.read(name)
            if name == "data" and edit is not None:
                fields = json.loads(old.read(name))
                edit(fields)
                content = json.dumps(fields).encode()
            if content is not None:
                new.writestr(name, content)
    return target


def state_dict(path: Path) -> dict[str, Any]:
    with zipfile.ZipFile(path) as archive:
        return dict(torch.load(io.BytesIO(archive.read("policy.pth")), weights_only=True))


def saved(tensors: object) -> bytes:
    stream = io.BytesIO()
    torch.save(tensors, stream)
    return stream.getvalue()


def refusal(path: Path, *args: Any, **kwargs: Any) -> str:
    """The message with which a file is refused: the path, then one line, one sentence, a remedy."""
    with pytest.raises(PolicyFileError) as caught:
        read_sb3_zip(path, *args, **kwargs)
    message = str(caught.value)
    start = f"{path}: "
    assert message.startswith(start)
    sentence = message[len(start) :]
    assert "\n" not in sentence
    assert not re.search(r"\. [A-Z]", sentence)
    assert "; " in sentence
    return sentence


def read_or_none(path: Path) -> MlpPolicy | None:
    """The policy, or None where it is refused; any other exception is a failure."""
    try:
        return read_sb3_zip(path)
    except PolicyFileError:
        return None


# --- equal to SB3 ----------------------------------------------------------------------------


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


class BoxEnv(gym.Env[Any, Any]):
    """Just enough of an environment to build a model for given spaces."""

    def __init__(self, observation_space: spaces.Space[Any], action_space: spaces.Space[Any]):
        self.observation_space, self.action_space = observation_space, action_space

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        return self.observation_space.sample(), {}


UNIT_3 = spaces.Box(-1.0, 1.0, (3,))


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
    message = refusal(scratch / "many.zip", action_bounds=([-1.0], [1.0]))
    assert "action_bounds have length 1 and the action space 1200" in message


# --- nothing is executed, nothing else is needed ----------------------------------------------


class Touch:
    """Creates a file when unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return (open, (str(self.path), "w"))


@pytest.fixture
def trap(tmp_path: Path) -> Iterator[tuple[Touch, Path]]:
    """An object that creates a file when unpickled, shown to work, and that file, absent."""
    bait = tmp_path / "executed"
    pickle.loads(pickle.dumps(Touch(bait))).close()
    assert bait.exists()
    bait.unlink()
    yield Touch(bait), bait
    assert not bait.exists(), "reading the policy executed code from the file"


def test_pickled_data_is_never_decoded(pendulum_zip: Path, trap: tuple[Touch, Path]) -> None:
    touch, bait = trap
    payload = base64.b64encode(pickle.dumps(touch)).decode()

    def poison(data: dict[str, Any]) -> None:
        for value in data.values():
            if isinstance(value, dict):
                value[":serialized:"] = payload
        data["extra"] = {":type:": "<class 'x'>", ":serialized:": payload}

    evil = rewritten(
        pendulum_zip,
        bait.with_name("evil.zip"),
        poison,
        pytorch_variables__pth=saved(touch),
        policy__optimizer__pth=saved(touch),
    )
    assert read_sb3_zip(evil).content_hash == read_sb3_zip(pendulum_zip).content_hash


def test_pickled_weights_are_never_executed(pendulum_zip: Path, trap: tuple[Touch, Path]) -> None:
    touch, bait = trap
    tensors = state_dict(pendulum_zip)
    for payload in (saved(touch), saved({**tensors, "log_std": touch})):
        evil = rewritten(pendulum_zip, bait.with_name("evil.zip"), policy__pth=payload)
        assert "holds something other than plain weights" in refusal(evil)
    evil = rewritten(pendulum_zip, bait.with_name("evil.zip"), policy__pth=pickle.dumps(touch))
    assert "is not in torch's zip format" in refusal(evil)


def test_sb3_is_not_needed(pendulum_zip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    assert read_sb3_zip(pendulum_zip).observation_shape == (3,)


def test_without_torch_one_line_says_what_to_install(
    pendulum_zip: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(ImportError) as caught:
        read_sb3_zip(pendulum_zip)
    assert str(caught.value) == 'torch is not installed; run: pip install "integ-gym[train]"'


# --- refusals ---------------------------------------------------------------------------------


def setting(*keys: str, to: object) -> Callable[[dict[str, Any]], None]:
    """An edit of `data` that sets one (nested) value."""

    def edit(data: dict[str, Any]) -> None:
        for key in keys[:-1]:
            data = data[key]
        data[keys[-1]] = to

    return edit


def discrete(n: str, start: str = "0", squash: bool = False) -> Callable[[dict[str, Any]], None]:
    """An edit of `data` that makes the action space Discrete."""

    def edit(data: dict[str, Any]) -> None:
        data["action_space"] = {
            ":type:": "<class 'gymnasium.spaces.discrete.Discrete'>",
            "n": n,
            "start": start,
        }
        data["use_sde"] = squash
        data["policy_kwargs"]["squash_output"] = squash

    return edit


KWARGS, BOX = "policy_kwargs", "action_space"
UNREADABLE_DATA: list[tuple[Callable[[dict[str, Any]], None], str]] = [
    (
        setting("policy_class", "__module__", to="sb3_contrib.common.recurrent.policies"),
        "ActorCriticPolicy of sb3_contrib.common.recurrent.policies, and only PPO's and A2C's",
    ),
    (
        setting("policy_class", "__init__", to="<function ActorCriticCnnPolicy.__init__ at 0x1>"),
        "the policy class is ActorCriticCnnPolicy of stable_baselines3.common.policies",
    ),
    (setting("policy_class", "__init__", to=3), "a class without a readable name"),
    (setting("policy_class", to="text"), "no readable 'policy_class'"),
    (setting(KWARGS, to=None), "no readable 'policy_kwargs'"),
    (setting(KWARGS, "lstm_hidden_size", to=256), "policy_kwargs 'lstm_hidden_size' are not known"),
    (
        setting(KWARGS, "features_extractor_class", to="<class '__main__.Mine'>"),
        "features extractor <class '__main__.Mine'> cannot be read, only FlattenExtractor",
    ),
    (
        setting(KWARGS, "activation_fn", to="<class '__main__.ReLU'>"),
        "activation function <class '__main__.ReLU'> is not known",
    ),
    (setting(KWARGS, "activation_fn", to=TORCH_CLASS.format("PReLU")), "is not known; train with"),
    (setting(KWARGS, "activation_fn", to="functools.partial(<class 'x'>)"), "functools.partial"),
    (setting(KWARGS, "net_arch", to="{'pi': [np.int64(64)]}"), "the net_arch \"{'pi'"),
    (setting(KWARGS, "net_arch", to=[64, {"pi": [64]}]), "cannot be read; train with"),
    (setting(KWARGS, "net_arch", to=[64, 0]), "the net_arch [64, 0] cannot be read"),
    (setting(KWARGS, "net_arch", to={"pi": [True]}), "cannot be read"),
    (setting(KWARGS, "squash_output", to=True), "squash_output=True with use_sde=False"),
    (setting("use_sde", to="yes"), "use_sde='yes' is not a setting"),
    (setting("observation_space", to=[]), "no readable 'observation_space'"),
    (
        setting("observation_space", ":type:", to="<class 'gymnasium.spaces.dict.Dict'>"),
        "the observation space is Dict of shape [3], and only a one-dimensional Box can be read",
    ),
    (setting("observation_space", ":type:", to="<class 'mine.Box'>"), "is <class 'mine.Box'> of"),
    (setting("observation_space", "_shape", to=[3, 4]), "is Box of shape [3, 4]"),
    (setting("observation_space", "_shape", to="(3,)"), "is Box of shape (3,)"),
    (setting("observation_space", "_shape", to=[True]), "is Box of shape [True]"),
    (setting("observation_space", "_shape", to=[0]), "is Box of shape [0]"),
    (setting("observation_space", "_shape", to=[4]), "should have shape (64, 4)"),
    (setting(BOX, to=None), "no readable 'action_space'"),
    (
        setting(BOX, ":type:", to="<class 'gymnasium.spaces.multi_discrete.MultiDiscrete'>"),
        "the action space is MultiDiscrete of shape [1], and only a one-dimensional Box or Dis",
    ),
    (setting(BOX, "dtype", to="float64"), "has dtype float64, and only float32 can be read"),
    (setting(BOX, "low", to="[-1. ... -1.]"), "does not spell out 1 numbers"),
    (setting(BOX, "low", to="[-2. -2.]"), "printed as [-2. -2.], which does not spell out 1"),
    (setting(BOX, "low", to="[nan]"), "does not spell out 1 numbers"),
    (setting(BOX, "low", to="-2."), "does not spell out 1 numbers"),
    (setting(BOX, "low", to="[[-2.]]"), "does not spell out 1 numbers"),
    (setting(BOX, "low", to="[__import__('os')]"), "does not spell out 1 numbers"),
    (setting(BOX, "low", to=-2.0), "printed as -2.0, which does not spell out 1 numbers"),
    (setting(BOX, "low", to="[" + "x" * 999), "x..., which does not spell out"),
    (setting(BOX, "high", to="[0.01234568]"), "'high' is printed as 0.01234568, which may be"),
    (
        setting(BOX, "low", to="[3.]"),
        "finite and 'low' not above 'high', got Box([3.0], [2.0]); give",
    ),
    (setting(BOX, "high", to="[inf]"), "must be finite and 'low' not above 'high', got Box([-2."),
    (discrete("0"), "Discrete(n=0, start=0) cannot be read"),
    (discrete("two"), "Discrete(n=two, start=0) cannot be read"),
    (discrete("2", start="1"), "counts actions from 0; train in an environment with start=0"),
    (discrete("1", squash=True), "the action space Discrete(1) has no bounds"),
    (discrete("2"), "'action_net.weight' should have shape (2, 64)"),
    (setting(KWARGS, "net_arch", to=[64]), "'mlp_extractor.policy_net.2.weight' have no place in"),
    (setting(KWARGS, "net_arch", to=[64, 32]), "should have shape (32, 64) for the saved arch"),
    (setting(KWARGS, "net_arch", to=[64, 64, 64]), "and have none; save it again"),
]


@pytest.mark.parametrize(("edit", "reason"), UNREADABLE_DATA)
def test_data_that_does_not_settle_the_policy_is_refused(
    edit: Callable[[dict[str, Any]], None], reason: str, pendulum_zip: Path, tmp_path: Path
) -> None:
    assert reason in refusal(rewritten(pendulum_zip, tmp_path / "edited.zip", edit))


def test_harmless_data_is_accepted(pendulum_zip: Path, tmp_path: Path) -> None:
    def edit(data: dict[str, Any]) -> None:
        data["policy_kwargs"] = {
            ":type:": "<class 'dict'>",
            "net_arch": [{"pi": [64, 64], "vf": [1]}],
            "activation_fn": TORCH_CLASS.format("Tanh"),
            "features_extractor_class": sb3_zip._FLATTEN,
            "optimizer_class": "<class 'mine.Optimizer'>",
            "log_std_init": -1.0,
        }
        data["observation_space"][":type:"] = "<class 'gym.spaces.box.Box'>"

    policy = read_sb3_zip(rewritten(pendulum_zip, tmp_path / "edited.zip", edit))
    assert policy.content_hash == read_sb3_zip(pendulum_zip).content_hash


def test_other_algorithms_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.zip"
    sb3.SAC("MlpPolicy", "Pendulum-v1", device="cpu", buffer_size=10).save(path)
    assert "the policy class is SACPolicy of stable_baselines3.sac.policies" in refusal(path)
    sb3.DQN("MlpPolicy", "CartPole-v1", device="cpu", buffer_size=10).save(path)
    assert "the policy class is DQNPolicy of stable_baselines3.dqn.policies" in refusal(path)
    env = BoxEnv(spaces.Dict(a=UNIT_3), spaces.Discrete(2))
    sb3.PPO("MultiInputPolicy", env, device="cpu").save(path)
    assert "the policy class is MultiInputActorCriticPolicy of" in refusal(path)
    env = BoxEnv(spaces.Discrete(4), spaces.Discrete(2))
    sb3.PPO("MlpPolicy", env, device="cpu").save(path)
    assert "the observation space is Discrete of shape []" in refusal(path)


def edited_tensors(name: str, tensor: Any) -> Callable[[dict[str, Any]], object]:
    return lambda tensors: {**tensors, name: tensor}


WRONG_WEIGHTS: list[tuple[Callable[[dict[str, Any]], object], str]] = [
    (lambda tensors: list(tensors.values()), "other than float32 weights"),
    (lambda tensors: {1: torch.zeros(1)}, "other than float32 weights"),
    (edited_tensors("action_net.bias", [0.0]), "other than float32 weights"),
    (edited_tensors("action_net.bias", torch.zeros(1).double()), "other than float32 weights"),
    (edited_tensors("action_net.bias", torch.zeros(1, device="meta")), "other than float32"),
    (edited_tensors("action_net.bias", torch.zeros(1).to_sparse()), "other than float32 weights"),
    (edited_tensors("action_net.bias", torch.zeros(2)), "should have shape (1,) for the saved"),
    (edited_tensors("action_net.bias", torch.tensor([torch.nan])), "so training diverged"),
    (edited_tensors("features_extractor.cnn.0.weight", torch.zeros(1)), "have no place in the"),
    (lambda tensors: {}, "'mlp_extractor.policy_net.0.weight' should have shape (64, 3)"),
]


@pytest.mark.parametrize(("edit", "reason"), WRONG_WEIGHTS)
def test_weights_that_are_not_the_architectures_are_refused(
    edit: Callable[[dict[str, Any]], object], reason: str, pendulum_zip: Path, tmp_path: Path
) -> None:
    content = saved(edit(state_dict(pendulum_zip)))
    assert reason in refusal(rewritten(pendulum_zip, tmp_path / "edited.zip", policy__pth=content))


def test_a_torchscript_program_is_refused(pendulum_zip: Path, tmp_path: Path) -> None:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("archive/constants.pkl", b"")
    content = stream.getvalue()
    path = rewritten(pendulum_zip, tmp_path / "script.zip", policy__pth=content)
    assert "is a TorchScript program, not weights" in refusal(path)


def test_a_path_that_cannot_be_opened_is_refused(tmp_path: Path) -> None:
    assert "cannot be opened (No such file or directory)" in refusal(tmp_path / "none.zip")
    assert "cannot be opened (Is a directory)" in refusal(tmp_path)


def test_a_file_that_is_not_a_model_is_refused(pendulum_zip: Path, tmp_path: Path) -> None:
    path = tmp_path / "model.zip"
    path.write_bytes(b"PK not a zip")
    assert "is not a complete zip file" in refusal(path)
    assert "has no member 'data'" in refusal(rewritten(pendulum_zip, path, data=None))
    assert "has no member 'policy.pth'" in refusal(rewritten(pendulum_zip, path, policy__pth=None))


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"{", "its member 'data' is not readable JSON"),
        (b"\xff", "its member 'data' is not readable JSON"),
        (b"[" * 100_000, "its member 'data' is not readable JSON"),
        (b"[]", "its member 'data' is not a JSON object"),
    ],
    ids=["truncated", "not-utf8", "too-deep", "list"],
)
def test_data_that_is_not_an_object_is_refused(
    content: bytes, reason: str, pendulum_zip: Path, tmp_path: Path
) -> None:
    assert reason in refusal(rewritten(pendulum_zip, tmp_path / "data.zip", data=content))


def test_an_unreadable_member_is_refused(pendulum_zip: Path, tmp_path: Path) -> None:
    content = bytearray(pendulum_zip.read_bytes())
    with zipfile.ZipFile(pendulum_zip) as archive:
        directory = archive.start_dir
    content[directory + 8] |= 1  # the flag of an encrypted member
    path = tmp_path / "encrypted.zip"
    path.write_bytes(content)
    assert "cannot be unpacked (RuntimeError)" in refusal(path)


@given(cut=st.floats(0, 1, exclude_max=True))
@settings(deadline=None, max_examples=40)
def test_a_truncated_file_is_refused(pendulum_zip: Path, scratch: Path, cut: float) -> None:
    content = pendulum_zip.read_bytes()
    path = scratch / "truncated.zip"
    path.write_bytes(content[: int(cut * len(content))])
    assert refusal(path)


@given(where=st.integers(1, 10**9), bit=st.integers(0, 7))
@settings(deadline=None, max_examples=100)
def test_a_flipped_bit_is_refused_or_harmless(
    pendulum_zip: Path, scratch: Path, where: int, bit: int
) -> None:
    content = bytearray(pendulum_zip.read_bytes())
    content[-1 - where % 700] ^= 1 << bit  # the zip directory, which no checksum protects
    content[where % len(content)] ^= 1 << bit
    path = scratch / "flipped.zip"
    path.write_bytes(content)
    policy = read_or_none(path)
    if policy is None:
        assert refusal(path)
    else:
        assert policy.content_hash == read_sb3_zip(pendulum_zip).content_hash


def test_members_above_the_limit_are_refused_unread(
    pendulum_zip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with zipfile.ZipFile(pendulum_zip) as archive:
        weights = archive.getinfo("policy.pth").file_size
        data = archive.getinfo("data").file_size
    monkeypatch.setattr(zipfile.ZipFile, "read", lambda *_: pytest.fail("the bomb was unpacked"))
    monkeypatch.setattr(sb3_zip, "MAX_JSON_BYTES", data - 1)
    assert f"'data' of {data} bytes, above the limit of {data - 1}" in refusal(pendulum_zip)
    monkeypatch.undo()
    monkeypatch.setattr(sb3_zip, "MAX_WEIGHTS_BYTES", weights - 1)
    assert f"'policy.pth' of {weights} bytes, above the limit of" in refusal(pendulum_zip)


def test_weights_that_unpack_above_the_limit_are_refused(
    pendulum_zip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("archive/data.pkl", bytes(10**6))
    path = rewritten(pendulum_zip, tmp_path / "bomb.zip", policy__pth=stream.getvalue())
    monkeypatch.setattr(sb3_zip, "MAX_WEIGHTS_BYTES", 10**5)
    assert "unpacks to 1000000 bytes, above the limit of 100000" in refusal(path)


def test_weights_that_are_few_numbers_repeated_often_are_refused(
    pendulum_zip: Path, tmp_path: Path
) -> None:
    wide = 2**20
    tensors = state_dict(pendulum_zip)
    one = torch.zeros(1)
    tensors |= {
        "mlp_extractor.policy_net.0.weight": one.expand(wide, 3),
        "mlp_extractor.policy_net.0.bias": one.expand(wide),
        "mlp_extractor.policy_net.2.weight": one.expand(wide, wide),
        "mlp_extractor.policy_net.2.bias": one.expand(wide),
        "action_net.weight": one.expand(1, wide),
    }
    edit = setting(KWARGS, "net_arch", to=[wide, wide])
    path = rewritten(pendulum_zip, tmp_path / "wide.zip", edit, policy__pth=saved(tensors))
    assert "the actor needs more than 268435456 bytes" in refusal(path)


# --- statistics files -------------------------------------------------------------------------

GOOD_STATISTICS = {"mean": [0.0, 1, -2.5], "var": [1.0, 0, 4.0], "epsilon": 1e-8, "clip_obs": 10}


def test_statistics_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "statistics.json"
    path.write_text(json.dumps(GOOD_STATISTICS))
    statistics = read_observation_statistics(path)
    np.testing.assert_array_equal(statistics.mean, [0.0, 1.0, -2.5])
    np.testing.assert_array_equal(statistics.var, [1.0, 0.0, 4.0])
    assert (statistics.epsilon, statistics.clip_obs) == (1e-8, 10.0)
    normal = statistics.normalize(np.array([[0.5, 1.0, 97.5]], dtype=np.float32))
    np.testing.assert_allclose(normal, [[0.5, 0.0, 10.0]], rtol=1e-6)
    assert normal.dtype == np.float32


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("{", "the file is not readable JSON"),
        ("3", "the file is not a JSON object"),
        ("{}", "expected the keys clip_obs, epsilon, mean, var, got "),
        ({"count": 1}, "got clip_obs, count, epsilon, mean, var"),
        ({"mean": 0.0}, "'mean' must be a list of finite numbers"),
        ({"mean": [0.0, "1", 2]}, "'mean' must be a list of finite numbers"),
        ({"mean": [True, False, True]}, "'mean' must be a list of finite numbers"),
        ({"mean": [0.0, 1.0, float("nan")]}, "'mean' must be a list of finite numbers"),
        ({"mean": [0, 1, 10**400]}, "'mean' must be a list of finite numbers"),
        ({"var": [1.0, 2.0, float("inf")]}, "'var' must be a list of finite numbers"),
        ({"var": [1.0, 2.0]}, "of one length, got shapes (3,) and (2,)"),
        ({"var": [1.0, -2.0, 1.0]}, "'var' must hold no negative number, got -2.0"),
        ({"epsilon": "small"}, "'epsilon' must be a finite number, got 'small'"),
        ({"epsilon": 0}, "'epsilon' must be a finite number above 0, got 0"),
        ({"clip_obs": None}, "'clip_obs' must be a finite number, got None"),
        ({"clip_obs": -1.0}, "'clip_obs' must be a finite number above 0, got -1.0"),
    ],
)
def test_wrong_statistics_are_refused(
    content: str | dict[str, Any], reason: str, tmp_path: Path, pendulum_zip: Path
) -> None:
    path = tmp_path / "statistics.json"
    text = content if isinstance(content, str) else json.dumps(GOOD_STATISTICS | content)
    path.write_text(text)
    for read in (read_observation_statistics, lambda p: read_sb3_zip(pendulum_zip, p)):
        with pytest.raises(PolicyFileError) as caught:
            read(path)
        message = str(caught.value)
        assert message.startswith(f"{path}: ")
        assert reason in message
        assert "; write {" in message
        assert "\n" not in message


def test_statistics_that_cannot_be_opened_or_are_too_large_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "statistics.json"
    with pytest.raises(PolicyFileError, match=r"cannot be opened \(No such file"):
        read_observation_statistics(path)
    path.write_text(json.dumps(GOOD_STATISTICS))
    monkeypatch.setattr(sb3_zip, "MAX_JSON_BYTES", 10)
    with pytest.raises(PolicyFileError, match="is larger than 10 bytes; write"):
        read_observation_statistics(path)


def test_statistics_of_another_length_are_refused(pendulum_zip: Path, tmp_path: Path) -> None:
    path = tmp_path / "statistics.json"
    path.write_text(json.dumps(GOOD_STATISTICS | {"mean": [0.0], "var": [1.0]}))
    message = refusal(pendulum_zip, path)
    assert "statistics have shape (1,) and the policy takes observations of shape (3,)" in message


# --- the policy by itself ---------------------------------------------------------------------

Layers = tuple[tuple[np.ndarray, np.ndarray], ...]


def layers(*sizes: int, seed: int = 0) -> Layers:
    rng = np.random.default_rng(seed)
    return tuple(
        (rng.normal(size=(after, before)), rng.normal(size=after))
        for before, after in pairwise(sizes)
    )


BOX_ACTIONS = BoxActions(np.array([-1.0, 0.0]), np.array([1.0, 3.0]))
BOX_POLICY = MlpPolicy(layers(3, 5, 2), "Tanh", BOX_ACTIONS, policy_id="box")
DISCRETE_POLICY = MlpPolicy(layers(4, 6, 3), "ReLU", DiscreteActions(3), policy_id="discrete")
STATISTICS = ObservationStatistics(np.zeros(3), np.ones(3), epsilon=1e-8, clip_obs=10.0)
SIMPLE = MlpPolicy(
    ((np.array([[1.0, -2.0]]), np.array([0.5])),),
    "Tanh",
    BoxActions(np.array([-2.0]), np.array([2.0])),
)
SIMPLE_HASH = "95fb6ac8dc8ea1ea00856fe626fdb9e78f4aa97ff099e75fccaa80b262397d60"


@pytest.mark.parametrize("policy", [BOX_POLICY, DISCRETE_POLICY])
def test_policy_protocol(policy: MlpPolicy) -> None:
    assert isinstance(policy, Policy)


@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(0, 9),
    scale=st.floats(0, 10) | st.floats(0, 1e30),
    squash=st.booleans(),
)
@settings(deadline=None)
def test_rows_are_independent_and_within_bounds(
    seed: int, n: int, scale: float, squash: bool
) -> None:
    policy = replace(BOX_POLICY, actions=replace(BOX_ACTIONS, squash=squash))
    observations = np.random.default_rng(seed).normal(size=(n, 3)) * scale
    actions = policy.act(observations)
    assert actions.shape == (n, 2)
    assert actions.dtype == np.float32
    assert (actions >= BOX_ACTIONS.low).all()
    assert (actions <= BOX_ACTIONS.high).all()
    if scale <= 10.0:
        alone = [policy.act(observation[None])[0] for observation in observations]
        np.testing.assert_allclose(np.reshape(alone, (n, 2)), actions, rtol=0, atol=1e-4)


def test_discrete_actions_are_the_first_largest_output() -> None:
    tie = np.array([[0.0, 1.0, 1.0], [2.0, 1.0, 2.0]], dtype=np.float32)
    choice = DiscreteActions(3).decode(tie)
    assert choice.dtype == np.int64
    np.testing.assert_array_equal(choice, [1, 0])
    assert DISCRETE_POLICY.act(np.zeros((0, 4))).shape == (0,)


def test_a_nan_observation_gives_a_nan_action_in_its_row_only() -> None:
    observations = np.zeros((2, 3))
    observations[1, 0] = np.nan
    np.testing.assert_array_equal(
        np.isnan(BOX_POLICY.act(observations)), [[False, False], [True, True]]
    )
    with pytest.raises(ValueError, match="gives NaN, so no discrete action can be chosen; give"):
        DISCRETE_POLICY.act(np.full((1, 4), np.nan))


@pytest.mark.parametrize("shape", [(3,), (1, 4), (2, 1, 3)])
def test_observations_of_another_shape_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError) as caught:
        BOX_POLICY.act(np.zeros(shape))
    assert f"expected observations of shape (n, 3), got {shape}; pass a" in str(caught.value)


def test_content_hash_is_fixed_across_versions_and_processes() -> None:
    assert SIMPLE.content_hash == SIMPLE_HASH
    code = (
        "import sys; sys.modules['torch'] = None; import numpy as np\n"
        "from integ_gym.train.policy import BoxActions, MlpPolicy\n"
        "layer = (np.array([[1.0, -2.0]]), np.array([0.5]))\n"
        "actions = BoxActions(np.array([-2.0]), np.array([2.0]))\n"
        "print(MlpPolicy((layer,), 'Tanh', actions).content_hash)"
    )
    printed = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "PYTHONHASHSEED": "77"},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert printed.strip() == SIMPLE_HASH


def test_content_hash_covers_all_that_decides_the_action() -> None:
    nudged = ((SIMPLE.layers[0][0] + np.float32(1e-6), SIMPLE.layers[0][1]),)
    shifted = ((SIMPLE.layers[0][0], np.array([0.5000001])),)
    two = ObservationStatistics(np.zeros(2), np.ones(2), epsilon=1e-8, clip_obs=10.0)
    others = [
        replace(SIMPLE, activation="ReLU"),
        replace(SIMPLE, layers=nudged),
        replace(SIMPLE, layers=shifted),
        replace(SIMPLE, actions=DiscreteActions(1)),
        replace(SIMPLE, actions=replace(SIMPLE.actions, squash=True)),
        replace(SIMPLE, actions=replace(SIMPLE.actions, high=np.array([3.0]))),
        replace(SIMPLE, statistics=two),
        replace(SIMPLE, statistics=replace(two, mean=np.array([0.0, 1e-9]))),
        replace(SIMPLE, statistics=replace(two, var=np.array([1.0, 2.0]))),
        replace(SIMPLE, statistics=replace(two, epsilon=1e-7)),
        replace(SIMPLE, statistics=replace(two, clip_obs=9.0)),
    ]
    hashes = {policy.content_hash for policy in [SIMPLE, *others]}
    assert len(hashes) == 1 + len(others)


def test_content_hash_leaves_the_name_and_the_float_width_of_the_input_out() -> None:
    assert replace(BOX_POLICY, policy_id="other").content_hash == BOX_POLICY.content_hash
    narrow = tuple((w.astype(np.float32), b.astype(np.float32)) for w, b in layers(3, 5, 2))
    assert replace(BOX_POLICY, layers=narrow).content_hash == BOX_POLICY.content_hash
    assert pickle.loads(pickle.dumps(BOX_POLICY)).content_hash == BOX_POLICY.content_hash


def test_a_policy_cannot_change_after_it_was_made() -> None:
    own = layers(3, 5, 2)
    policy = MlpPolicy(own, "Tanh", BOX_ACTIONS, STATISTICS)
    own[0][0][:] = 0.0
    assert policy.content_hash == replace(BOX_POLICY, statistics=STATISTICS).content_hash
    for array in (policy.layers[0][0], BOX_ACTIONS.low, STATISTICS.mean):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: replace(BOX_POLICY, activation="Sine"), "'Sine' is not known; use one of ELU, "),
        (lambda: replace(BOX_POLICY, layers=()), "a policy needs at least one layer, got none"),
        (
            lambda: replace(BOX_POLICY, layers=(*layers(3, 5), *layers(4, 2))),
            "layer 1 has a weight of shape (2, 4) and a bias of shape (2,) after 5 inputs; exp",
        ),
        (
            lambda: replace(BOX_POLICY, layers=((np.zeros((2, 3)), np.zeros(1)),)),
            "layer 0 has a weight of shape (2, 3) and a bias of shape (1,) after 3 inputs",
        ),
        (
            lambda: replace(BOX_POLICY, layers=((np.zeros(3), np.zeros(())),)),
            "layer 0 has a weight of shape (3,)",
        ),
        (
            lambda: replace(BOX_POLICY, layers=((np.full((2, 3), np.inf), np.zeros(2)),)),
            "layer 0 has weights that are not finite, so training diverged; train again",
        ),
        (
            lambda: replace(BOX_POLICY, layers=layers(3, 5, 3)),
            "the last layer has 3 outputs and the action space Box([-1.0, 0.0], [1.0, 3.0]) needs",
        ),
        (
            lambda: replace(DISCRETE_POLICY, actions=DiscreteActions(2)),
            "the last layer has 3 outputs and the action space Discrete(2) needs 2",
        ),
        (
            lambda: replace(DISCRETE_POLICY, statistics=STATISTICS),
            "statistics have shape (3,) and the policy takes observations of shape (4,); use the",
        ),
        (lambda: replace(BOX_ACTIONS, high=np.ones(3)), "of one shape, got (2,) and (3,)"),
        (
            lambda: replace(BOX_ACTIONS, high=np.full(2, np.nan)),
            "must be finite and 'low' not above",
        ),
        (lambda: DiscreteActions(0), "needs at least one action, got 0"),
        (lambda: replace(STATISTICS, mean=np.full(3, np.nan)), "must hold finite numbers only"),
    ],
)
def test_parts_that_do_not_fit_are_refused(make: Callable[[], object], reason: str) -> None:
    with pytest.raises(ValueError) as caught:
        make()
    assert reason in str(caught.value)


FITTING_BOX = spaces.Box(-9.0, 9.0, (3,))


def test_spaces_that_fit_are_accepted_whatever_their_bounds() -> None:
    BOX_POLICY.check_spaces(FITTING_BOX, spaces.Box(-7.0, 7.0, (2,)))
    DISCRETE_POLICY.check_spaces(
        spaces.Box(-np.inf, np.inf, (4,)), spaces.Discrete(3, dtype=np.int32)
    )


@pytest.mark.parametrize(
    ("policy", "observation_space", "action_space", "reason"),
    [
        (
            BOX_POLICY,
            spaces.Box(-1.0, 1.0, (4,)),
            BOX_ACTIONS.space,
            "policy 'box' expects observations of shape (3,) and the environment gives "
            "Box of shape (4,); evaluate it in",
        ),
        (BOX_POLICY, spaces.Discrete(3), BOX_ACTIONS.space, "the environment gives Discrete(3); "),
        (
            BOX_POLICY,
            FITTING_BOX,
            spaces.Box(-1.0, 1.0, (1,)),
            "policy 'box' gives actions for Box of shape (2,) and the environment takes "
            "Box of shape (1,); evaluate it in",
        ),
        (BOX_POLICY, FITTING_BOX, spaces.Discrete(2), "the environment takes Discrete(2); "),
        (
            DISCRETE_POLICY,
            spaces.Box(-1.0, 1.0, (4,)),
            spaces.Discrete(2),
            "policy 'discrete' gives actions for Discrete(3) and the environment takes Discrete(2)",
        ),
        (
            DISCRETE_POLICY,
            spaces.Box(-1.0, 1.0, (4,)),
            spaces.Discrete(3, start=1),
            "takes Discrete(3, start=1); ",
        ),
        (
            DISCRETE_POLICY,
            spaces.Box(-1.0, 1.0, (4,)),
            spaces.Box(-1.0, 1.0, (3,)),
            "takes Box of shape (3,); ",
        ),
    ],
)
def test_spaces_that_do_not_fit_are_refused(
    policy: MlpPolicy,
    observation_space: spaces.Space[Any],
    action_space: spaces.Space[Any],
    reason: str,
) -> None:
    with pytest.raises(ValueError) as caught:
        policy.check_spaces(observation_space, action_space)
    message = str(caught.value)
    assert reason in message
    assert message.endswith("trained in, or train one here")
    assert "\n" not in message
