"""Zips of stable-baselines3: read as their algorithms act, refused where anything does not fit."""

import base64
import io
import json
import os
import pickle
import sys
import tracemalloc
import zipfile
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import sb3_contrib
import stable_baselines3 as sb3
import torch
from gymnasium import spaces
from hypothesis import example, given, settings
from hypothesis import strategies as st
from policy_files import (
    UNIT_3,
    BoxEnv,
    read_or_none,
    refusal,
    rewritten,
    saved,
    setting,
    state_dict,
)
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from integ_gym.train.fleet.learning import ACTIVATIONS as FLEET_ACTIVATIONS
from integ_gym.train.policy import ACTIVATIONS, BoxActions, DiscreteActions
from integ_gym.train.policy_files import card as limits
from integ_gym.train.policy_files import sb3_weights as architecture
from integ_gym.train.policy_files.card import PolicyFileError
from integ_gym.train.policy_files.reading import read_weights
from integ_gym.train.policy_files.sb3_published import zip_faults
from integ_gym.train.policy_files.sb3_zip import read_sb3_model, read_sb3_zip
from integ_gym.train.policy_files.writing import save_policy

PENDULUM, CART_POLE = "Pendulum-v1", "CartPole-v1"
SMALL = {"net_arch": [16, 8]}
REPLAY = {"buffer_size": 10, "policy_kwargs": SMALL}
MODELS: dict[str, tuple[Any, str, dict[str, Any]]] = {
    "PPO": (sb3.PPO, PENDULUM, {}),
    "PPO, discrete": (sb3.PPO, CART_POLE, {"policy_kwargs": {"net_arch": [16, 8, 8]}}),
    "PPO, linear": (sb3.PPO, PENDULUM, {"policy_kwargs": {"net_arch": []}}),
    "PPO with nets apart": (
        sb3.PPO, PENDULUM,
        {"policy_kwargs": {"net_arch": {"pi": [32, 16], "vf": [64]}, "ortho_init": False}},
    ),
    "PPO with gSDE": (
        sb3.PPO, PENDULUM,
        {"use_sde": True, "policy_kwargs": {"use_expln": True, "full_std": False}},
    ),
    "PPO with gSDE, squashed": (
        sb3.PPO, PENDULUM,
        {"use_sde": True,
         "policy_kwargs": {"squash_output": True, "share_features_extractor": False}},
    ),
    "A2C": (sb3.A2C, CART_POLE, {}),
    "SAC": (sb3.SAC, PENDULUM, REPLAY),
    "SAC with gSDE": (
        sb3.SAC, PENDULUM,
        {"buffer_size": 10, "use_sde": True, "policy_kwargs": {**SMALL, "clip_mean": 0.03}},
    ),
    "SAC with nets apart": (
        sb3.SAC, PENDULUM,
        {"buffer_size": 10, "policy_kwargs": {"net_arch": {"pi": [8], "qf": [4]}}},
    ),
    "TD3": (sb3.TD3, PENDULUM, REPLAY),
    "DDPG": (sb3.DDPG, PENDULUM, REPLAY),
    "DQN": (sb3.DQN, CART_POLE, REPLAY),
    "TQC": (sb3_contrib.TQC, PENDULUM, REPLAY),
    "TRPO": (sb3_contrib.TRPO, PENDULUM, {}),
    "QR-DQN": (
        sb3_contrib.QRDQN, CART_POLE,
        {"buffer_size": 10, "policy_kwargs": {**SMALL, "n_quantiles": 7}},
    ),
    **{
        name: (sb3.PPO, PENDULUM, {"policy_kwargs": {"activation_fn": getattr(torch.nn, name)}})
        for name in ACTIVATIONS
    },
}  # fmt: skip


def _moved(model):
    """The model with all its weights, biases too, away from where it begins."""
    torch.manual_seed(0)
    with torch.no_grad():
        for weights in model.policy.parameters():
            weights += 0.1 * torch.randn_like(weights)
    return model


def _observations(dim):
    """Observations whose size grows from 0.1 to 1000."""
    sizes = np.geomspace(0.1, 1e3, 200)[:, None]
    return (np.random.default_rng(3).normal(size=(200, dim)) * sizes).astype(np.float32)


def _assert_close(policy, observations, expected):
    """Actions agree but for what float32 sums in another order may differ by, more for far ones."""
    actions = policy.act(observations)
    assert (actions.shape, actions.dtype) == (expected.shape, expected.dtype)
    assert np.unique(actions).size > 1, "a constant policy would prove nothing"
    rounding = 1e-5 * np.maximum(1.0, np.abs(observations).max(axis=1, keepdims=True) / 10.0)
    if isinstance(policy.actions, DiscreteActions):
        outputs = np.sort(policy.outputs(observations), axis=1)
        decided = outputs[:, -1] - outputs[:, -2] > 10 * rounding[:, 0]
        assert decided.mean() > 0.9
        np.testing.assert_array_equal(actions[decided], expected[decided])
    else:
        assert (np.abs(actions - expected) / rounding).max() < 1.0


def _under_gym(data):
    """As files were written under gym: other modules, and `shape` in place of `_shape`."""
    for name in ("observation_space", "action_space"):
        space = data[name]
        space[":type:"] = space[":type:"].replace("gymnasium.", "gym.")
        space["shape"] = space.pop("_shape")
        for later in ("start", "low_repr", "high_repr"):
            space.pop(later, None)
    if "n" in data["action_space"]:
        data["action_space"]["n"] = int(data["action_space"]["n"])


@pytest.mark.parametrize("name", MODELS)
def test_acts_as_the_model_in_both_layouts(name, tmp_path):
    algorithm, env_id, arguments = MODELS[name]
    model = _moved(algorithm("MlpPolicy", env_id, seed=0, device="cpu", **deepcopy(arguments)))
    path = tmp_path / "model.zip"
    model.save(path)
    policy = read_sb3_zip(path)
    assert policy.policy_id == "model"
    assert policy.activation == name or name not in ACTIVATIONS
    env = gym.make(env_id)
    policy.check_spaces(env.observation_space, env.action_space)
    assert policy.actions.space == env.action_space
    observations = _observations(*policy.observation_shape)
    expected, _ = model.predict(observations, deterministic=True)
    _assert_close(policy, observations, expected)
    old = read_sb3_zip(rewritten(path, tmp_path / "old.zip", _under_gym))
    assert old.content_hash == policy.content_hash
    assert read_sb3_model(model, "model").content_hash == policy.content_hash


@pytest.mark.parametrize("name", ACTIVATIONS)
def test_activation_equals_torch_s_in_numpy_and_jax(name):
    values = np.concatenate([np.linspace(-30, 30, 2001), [-1e30, -1e4, 0.0, 1e4, 1e30]])
    x = values.astype(np.float32)
    expected = getattr(torch.nn, name)()(torch.tensor(x)).numpy()
    actual = ACTIVATIONS[name](x)
    assert actual.dtype == np.float32
    np.testing.assert_allclose(actual, expected, rtol=1e-5, atol=1e-6)
    near = slice(800, 1200)
    np.testing.assert_allclose(FLEET_ACTIVATIONS[name](x[near]), expected[near], atol=2e-6)
    assert set(FLEET_ACTIVATIONS) == set(ACTIVATIONS)


def test_statistics_act_as_vec_normalize_does(tmp_path):
    env = VecNormalize(DummyVecEnv([lambda: gym.make(PENDULUM)]), clip_obs=1.5, epsilon=1e-6)
    env.obs_rms.update(np.random.default_rng(0).normal(0.3, 2.0, size=(100, 3)))
    model = _moved(sb3.PPO("MlpPolicy", env, seed=0, device="cpu"))
    path = tmp_path / "model.zip"
    model.save(path)
    statistics = {"mean": env.obs_rms.mean.tolist(), "var": env.obs_rms.var.tolist()}
    statistics |= {"epsilon": env.epsilon, "clip_obs": env.clip_obs}
    (tmp_path / "statistics.json").write_text(json.dumps(statistics))
    policy, bare = read_sb3_zip(path, tmp_path / "statistics.json"), read_sb3_zip(path)
    observations = _observations(3)
    expected, _ = model.predict(env.normalize_obs(observations), deterministic=True)
    _assert_close(policy, observations, expected)
    assert np.abs(bare.act(observations) - expected).max() > 0.01
    assert bare.content_hash != policy.content_hash


@pytest.mark.parametrize("squash", [False, True])
def test_uneven_bounds_survive_their_printed_form(squash, tmp_path):
    low = np.array([-1.0, -1 / 3, -8.0], dtype=np.float32)
    high = np.array([1e-7, 2.0, 1e6], dtype=np.float32)
    env = BoxEnv(UNIT_3, spaces.Box(low, high))
    kwargs = {"squash_output": squash}
    model = sb3.PPO("MlpPolicy", env, device="cpu", use_sde=squash, policy_kwargs=kwargs)
    model.save(tmp_path / "uneven.zip")
    policy = read_sb3_zip(tmp_path / "uneven.zip")
    assert isinstance(policy.actions, BoxActions)
    np.testing.assert_array_equal(policy.actions.low, low)
    np.testing.assert_array_equal(policy.actions.high, high)
    near = _observations(3)[:60]
    expected, _ = model.predict(near, deterministic=True)
    np.testing.assert_allclose(policy.act(near) / [1.0, 1.0, 1e6], expected / [1.0, 1.0, 1e6],
                               rtol=0, atol=1e-5)  # fmt: skip


@given(st.floats(0, 1e9, width=32))
@example(0.41887903213500977)
@example(0.0833333358168602)
@example(0.05)
@settings(deadline=None, max_examples=30)
def test_a_printed_bound_is_exact_or_refused(pendulum_zip, scratch, value):
    high = np.array([value], dtype=np.float32)

    def print_bounds(data):
        data["action_space"] |= {"high": str(high), "low": str(-high)}

    path = rewritten(pendulum_zip, scratch / "printed.zip", print_bounds)
    if 0 < value < 0.125 and read_or_none(path) is None:
        assert "may be rounded; pass action_bounds" in refusal(path)
        return
    actions = read_sb3_zip(path).actions
    if value == 0 or value >= 0.125:
        np.testing.assert_array_equal(actions.high, high)
    np.testing.assert_allclose(actions.high, high, rtol=0, atol=5e-9)
    np.testing.assert_array_equal(actions.low, -actions.high)


def test_action_bounds_replace_the_printed_ones(tmp_path):
    high, path = np.linspace(1.0, 2.0, 1200, dtype=np.float32), tmp_path / "many.zip"
    env = BoxEnv(UNIT_3, spaces.Box(-high, high))
    sb3.PPO("MlpPolicy", env, device="cpu").save(path)
    assert "does not spell out 1200 numbers; pass action_bounds" in refusal(path)
    assert read_sb3_zip(path, action_bounds=(-high, high)).actions.space == env.action_space
    message = refusal(path, action_bounds=([-1.0, -1.0], [1.0, 1.0]))
    assert "action_bounds have length 2 and the action space 1200" in message


def test_layers_that_actor_and_critic_shared_before_1_8(tmp_path, pendulum_zip):
    tensors = state_dict(pendulum_zip)
    shared = {
        name.replace("policy_net", "shared_net"): x
        for name, x in tensors.items()
        if "policy_net" in name
    }
    kept = {name: x for name, x in tensors.items() if "mlp_extractor" not in name}
    for arch in ([64, 64], [64, 64, {"vf": [], "pi": []}]):

        def edit(data, arch=arch):
            data["policy_kwargs"]["net_arch"] = arch

        content = saved({**shared, **kept})
        path = rewritten(pendulum_zip, tmp_path / "old.zip", edit, policy__pth=content)
        assert read_sb3_zip(path).content_hash == read_sb3_zip(pendulum_zip).content_hash


TORCH_CLASS = "<class 'torch.nn.modules.activation.{}'>"


def discrete(n, start="0", squash=False):
    """An edit of `data` that makes the action space Discrete."""

    def edit(data):
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
    (setting("policy_class", "__module__", to="mine"), "ActorCriticPolicy of mine, and only the"),
    (setting("policy_class", "__init__", to=3), "a class without a readable name"),
    (setting("policy_class", to="text"), "no readable 'policy_class'"),
    (setting(KWARGS, to=None), "no readable 'policy_kwargs'"),
    (setting(KWARGS, "lstm_hidden_size", to=256), "policy_kwargs 'lstm_hidden_size' are not known"),
    (setting(KWARGS, "features_extractor_class", to="<class 'Mine'>"), "only FlattenExtractor"),
    (setting(KWARGS, "activation_fn", to="<class '__main__.ReLU'>"), "is not known; train with"),
    (setting(KWARGS, "net_arch", to="{'pi': [np.int64(64)]}"), "the net_arch \"{'pi'"),
    (setting(KWARGS, "net_arch", to=[64, 0]), "the net_arch [64, 0] cannot be read"),
    (setting(KWARGS, "squash_output", to=True), "squash_output=True with use_sde=False"),
    (setting("use_sde", to="yes"), "use_sde='yes' is not a setting"),
    (setting("observation_space", to=[]), "no readable 'observation_space'"),
    (
        setting("observation_space", ":type:", to="<class 'gymnasium.spaces.dict.Dict'>"),
        "the observation space is Dict of shape [3], and only a Box can be read",
    ),
    (setting("observation_space", "_shape", to=[3, 4]), "should have shape (64, 12)"),
    (setting("observation_space", "_shape", to=[0]), "is Box of shape [0]"),
    (
        setting(BOX, ":type:", to="<class 'gymnasium.spaces.multi_discrete.MultiDiscrete'>"),
        "the action space is MultiDiscrete of shape [1], and only a Box or Dis",
    ),
    (setting(BOX, "dtype", to="float64"), "has dtype float64, and only float32 can be read"),
    (setting(BOX, "low", to="[-1. ... -1.]"), "does not spell out 1 numbers"),
    (setting(BOX, "low", to="[nan]"), "does not spell out 1 numbers"),
    (setting(BOX, "low", to="[__import__('os')]"), "does not spell out 1 numbers"),
    (setting(BOX, "high", to="[0.01234568]"), "'high' is printed as 0.01234568, which may be"),
    (setting(BOX, "low", to="[3.]"), "'low' not above 'high', got Box([3.0], [2.0]); give"),
    (setting(BOX, "high", to="[inf]"), "must be finite and 'low' not above 'high', got Box([-2."),
    (discrete("0"), "Discrete(n=0, start=0) cannot be read"),
    (discrete("2", start="1"), "counts actions from 0; train in an environment with start=0"),
    (discrete("1", squash=True), "the action space Discrete(1) has no bounds"),
    (setting(KWARGS, "net_arch", to=[64]), "'mlp_extractor.policy_net.2.weight' have no place in"),
    (setting(KWARGS, "net_arch", to=[64, 32]), "should have shape (32, 64) for the saved arch"),
    (setting(KWARGS, "net_arch", to=[64, 64, 64]), "and have none; save it again"),
]


@pytest.mark.parametrize(("edit", "reason"), UNREADABLE_DATA)
def test_data_that_does_not_settle_the_policy_is_refused(edit, reason, pendulum_zip, tmp_path):
    assert reason in refusal(rewritten(pendulum_zip, tmp_path / "edited.zip", edit))


def test_harmless_data_is_accepted(pendulum_zip, tmp_path):
    def edit(data):
        data["policy_kwargs"] = {
            ":type:": "<class 'dict'>",
            "net_arch": [{"pi": [64, 64], "vf": [1]}],
            "activation_fn": TORCH_CLASS.format("Tanh"),
            "features_extractor_class": architecture._FLATTEN,
            "optimizer_class": "<class 'mine.Optimizer'>",
            "log_std_init": -1.0,
        }
        data["observation_space"][":type:"] = "<class 'gym.spaces.box.Box'>"

    policy = read_sb3_zip(rewritten(pendulum_zip, tmp_path / "edited.zip", edit))
    assert policy.content_hash == read_sb3_zip(pendulum_zip).content_hash


def test_other_policies_are_refused(tmp_path):
    path, two = tmp_path / "other.zip", spaces.Discrete(2)
    for policy, env, reason in (
        ("MultiInputPolicy", BoxEnv(spaces.Dict(a=UNIT_3), two), "MultiInputActorCriticPolicy of"),
        ("MlpPolicy", BoxEnv(spaces.Discrete(4), two), "the observation space is Discrete of"),
    ):
        sb3.PPO(policy, env, device="cpu").save(path)
        assert reason in refusal(path)
    sb3_contrib.RecurrentPPO("MlpLstmPolicy", PENDULUM, device="cpu").save(path)
    assert "judge the loaded model from Python" in refusal(path)
    kwargs = {"activation_fn": torch.nn.PReLU}
    model = sb3.PPO("MlpPolicy", PENDULUM, device="cpu", policy_kwargs=kwargs)
    with pytest.raises(PolicyFileError, match="the model mine: the activation function"):
        read_sb3_model(model, "mine")


def edited_tensors(name, tensor):
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
def test_weights_that_are_not_the_architectures_are_refused(edit, reason, pendulum_zip, tmp_path):
    content = saved(edit(state_dict(pendulum_zip)))
    assert reason in refusal(rewritten(pendulum_zip, tmp_path / "edited.zip", policy__pth=content))


def _old_format(tensors):
    stream = io.BytesIO()
    torch.save(tensors, stream, _use_new_zipfile_serialization=False)
    return stream.getvalue()


def test_weights_in_torchs_older_format_are_read(pendulum_zip, tmp_path):
    old = _old_format(state_dict(pendulum_zip))
    path = rewritten(pendulum_zip, tmp_path / "old.zip", policy__pth=old)
    assert read_sb3_zip(path).content_hash == read_sb3_zip(pendulum_zip).content_hash


def test_torchs_older_format_executes_nothing_and_takes_no_more_than_the_limit(
    pendulum_zip, tmp_path, monkeypatch
):
    bait, path = tmp_path / "touched", tmp_path / "old.zip"
    rewritten(pendulum_zip, path, policy__pth=_old_format({"log_std": Touch(bait)}))
    assert "holds something other than plain weights" in refusal(path)
    assert not bait.exists()
    old = _old_format(state_dict(pendulum_zip))
    count = (64 * 64).to_bytes(2, "little")
    huge = old.replace(b"M" + count, b"J" + (2**31 - 1).to_bytes(4, "little"))
    assert huge != old
    rewritten(pendulum_zip, path, policy__pth=huge)
    assert "asks for more memory than the limit" in refusal(path)
    for content in (old[:40], old[:-100]):
        rewritten(pendulum_zip, path, policy__pth=content)
        assert refusal(path)


def test_a_file_that_is_not_a_model_is_refused(pendulum_zip, tmp_path):
    path = tmp_path / "model.zip"
    assert "cannot be opened (No such file or directory)" in refusal(path)
    assert "cannot be opened (Is a directory)" in refusal(tmp_path)
    path.write_bytes(b"PK not a zip")
    assert "is not a complete zip file" in refusal(path)
    assert "has no member 'data'" in refusal(rewritten(pendulum_zip, path, data=None))
    assert "has no member 'policy.pth'" in refusal(rewritten(pendulum_zip, path, policy__pth=None))
    for content in (b"{", b"\xff", b"[" * 100_000, b"[]"):
        reason = "is not a JSON object" if content == b"[]" else "is not readable JSON"
        assert f"its member 'data' {reason}" in refusal(rewritten(pendulum_zip, path, data=content))
    content = bytearray(pendulum_zip.read_bytes())
    with zipfile.ZipFile(pendulum_zip) as archive:
        directory = archive.start_dir
    content[directory + 8] |= 1  # the flag of an encrypted member
    path.write_bytes(content)
    assert "cannot be unpacked (RuntimeError)" in refusal(path)


@given(where=st.integers(1, 10**9), bit=st.integers(0, 7))
@settings(deadline=None, max_examples=60)
def test_a_flipped_bit_is_refused_or_harmless(pendulum_zip, scratch, where, bit):
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


def test_members_above_the_limit_are_refused_unread(pendulum_zip, tmp_path, monkeypatch):
    with zipfile.ZipFile(pendulum_zip) as archive:
        weights = archive.getinfo("policy.pth").file_size
        data = archive.getinfo("data").file_size
    monkeypatch.setattr(zipfile.ZipFile, "open", lambda *_: pytest.fail("the bomb was unpacked"))
    monkeypatch.setattr(limits, "MAX_JSON_BYTES", data - 1)
    assert f"'data' of {data} bytes, above the limit of {data - 1}" in refusal(pendulum_zip)
    monkeypatch.undo()
    monkeypatch.setattr(limits, "MAX_WEIGHTS_BYTES", weights - 1)
    assert f"'policy.pth' of {weights} bytes, above the limit of" in refusal(pendulum_zip)
    monkeypatch.undo()
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("archive/data.pkl", bytes(10**6))
    path = rewritten(pendulum_zip, tmp_path / "bomb.zip", policy__pth=stream.getvalue())
    monkeypatch.setattr(limits, "MAX_WEIGHTS_BYTES", 10**5)
    assert "unpacks to 1000000 bytes, above the limit of 100000" in refusal(path)


def test_a_member_is_unpacked_no_further_than_it_declares(pendulum_zip, tmp_path):
    """64 MiB of zeros in 64 KiB, of which both headers say that they are 1000 bytes."""
    bomb, size = tmp_path / "bomb.zip", 64 << 20
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("data", bytes(size))
    told = size.to_bytes(4, "little")
    content = bomb.read_bytes()
    assert content.count(told) == 2
    bomb.write_bytes(content.replace(told, (1000).to_bytes(4, "little")))
    tracemalloc.start()
    try:
        assert "; " in refusal(bomb)
        assert tracemalloc.get_traced_memory()[1] < 16 << 20
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("packed", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_a_member_packed_otherwise_is_refused(packed, tmp_path):
    path = tmp_path / "packed.zip"
    with zipfile.ZipFile(path, "w", packed) as archive:
        archive.writestr("data", bytes(1000))
    assert "packed in a way that model.save(path) does not use" in refusal(path)


def test_what_has_no_end_is_refused(tmp_path):
    for ending in (".zip", ".pt", ".safetensors", ".onnx", ".pkl"):
        pipe = tmp_path / f"policy{ending}"
        os.mkfifo(pipe)
        card = {"network": {"activation": "Tanh"}}
        with pytest.raises(PolicyFileError, match=r"a device or a pipe|is a pickle"):
            read_weights(pipe, card)
    assert "a device or a pipe" in refusal(Path("/dev/zero"))


def test_weights_that_are_few_numbers_repeated_often_are_refused(pendulum_zip, tmp_path):
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
    edit = setting("policy_kwargs", "net_arch", to=[wide, wide])
    path = rewritten(pendulum_zip, tmp_path / "wide.zip", edit, policy__pth=saved(tensors))
    assert "the actor needs more than 268435456 bytes" in refusal(path)


class Touch:
    """Creates a file when unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return (open, (str(self.path), "w"))


@pytest.fixture
def trap(tmp_path):
    """An object that creates a file when unpickled, shown to work, and that file, absent."""
    bait = tmp_path / "executed"
    pickle.loads(pickle.dumps(Touch(bait))).close()
    assert bait.exists()
    bait.unlink()
    yield Touch(bait), bait
    assert not bait.exists(), "reading the policy executed code from the file"


def test_pickled_data_is_never_decoded(pendulum_zip, trap):
    touch, bait = trap
    payload = base64.b64encode(pickle.dumps(touch)).decode()

    def poison(data):
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


def test_pickled_weights_are_never_executed(pendulum_zip, trap):
    touch, bait = trap
    tensors = state_dict(pendulum_zip)
    for payload in (saved(touch), saved({**tensors, "log_std": touch})):
        evil = rewritten(pendulum_zip, bait.with_name("evil.zip"), policy__pth=payload)
        assert "holds something other than plain weights" in refusal(evil)
    evil = rewritten(pendulum_zip, bait.with_name("evil.zip"), policy__pth=pickle.dumps(touch))
    assert "is no file that torch.save wrote" in refusal(evil)


def test_what_is_put_into_a_published_zip_is_found(pendulum_zip, trap):
    touch, bait = trap
    weights = bait.with_name("policy.safetensors")
    save_policy(pendulum_zip, weights, "Pendulum-v1", home="stock")
    assert list(zip_faults(pendulum_zip, weights)) == []
    payload = base64.b64encode(pickle.dumps(touch)).decode()
    evil = rewritten(
        pendulum_zip, bait.with_name("evil.zip"), setting("seed", to={":serialized:": payload}),
        policy__optimizer__pth=saved(touch),
    )  # fmt: skip
    faults = list(zip_faults(evil, weights))
    assert [one.split(" when")[0] for one in faults] == [
        "policy.optimizer.pth imports io.open",
        "'seed' of its 'data' imports io.open",
    ]


def test_sb3_is_not_needed_and_torch_is(pendulum_zip, monkeypatch):
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    assert read_sb3_zip(pendulum_zip).observation_shape == (3,)
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(
        ImportError, match=r'torch is not installed; run: pip install -e "\.\[train'
    ):
        read_sb3_zip(pendulum_zip)
