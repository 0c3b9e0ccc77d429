"""Policies written as safetensors and ONNX are the same policies; graphs of others are judged."""

from __future__ import annotations

import json
import pickle
from itertools import pairwise
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from stable_baselines3 import DQN, PPO, SAC
from torch import nn

from integ_gym.eval.panel.existing.policy import hashes_of, read_policy_file
from integ_gym.train import read_weights, save_policy, write_sidecar
from integ_gym.train.policy import ACTIVATIONS, BoxActions, DiscreteActions, MlpPolicy
from integ_gym.train.policy.observation_statistics import ObservationStatistics
from integ_gym.train.policy_files.error import PolicyFileError
from integ_gym.train.policy_files.formats.onnx_file import OnnxPolicy, onnx_bytes, onnx_card
from integ_gym.train.policy_files.formats.onnx_file.reading import read_onnx
from integ_gym.train.policy_files.formats.safetensors_file import (
    read_safetensors,
    safetensors_bytes,
)
from integ_gym.train.policy_files.sidecar import read_trained

HOME = "integrator=explicit_euler,dt=0.05,control_period=0.1"


@st.composite
def policies(draw):
    random = np.random.default_rng(draw(st.integers(0, 1000)))
    sizes = [3, *draw(st.lists(st.integers(1, 9), max_size=2)), draw(st.integers(1, 4))]
    layers = tuple(
        (random.normal(size=(after, before)), random.normal(size=after))
        for before, after in pairwise(sizes)
    )
    bounds = -random.uniform(0.5, 2.0, sizes[-1]), random.uniform(0.5, 2.0, sizes[-1])
    kind = draw(st.sampled_from(["discrete", "clipped", "squashed", "limited"]))
    actions = {
        "discrete": lambda: DiscreteActions(sizes[-1]),
        "clipped": lambda: BoxActions(*bounds),
        "squashed": lambda: BoxActions(*bounds, squash=True),
        "limited": lambda: BoxActions(*bounds, squash=True, limit=0.5),
    }[kind]()
    statistics = None
    if draw(st.booleans()):
        mean, var = random.normal(size=3), random.uniform(0.1, 4.0, 3)
        statistics = ObservationStatistics(mean, var, 1e-8, 3.0)
    activation = draw(st.sampled_from(sorted(ACTIVATIONS)))
    return MlpPolicy(layers, activation, actions, statistics)


@given(policies())
@settings(deadline=None, max_examples=40)
def test_both_files_hold_the_same_policy(scratch, policy):
    path = scratch / "policy.safetensors"
    path.write_bytes(safetensors_bytes(policy))
    assert read_safetensors(path).content_hash == policy.content_hash
    path = scratch / "policy.onnx"
    path.write_bytes(onnx_bytes(policy, {}))
    observations = 3.0 * np.random.default_rng(0).normal(size=(50, 3))
    read, run = (
        read_onnx(path),
        OnnxPolicy(path.read_bytes(), isinstance(policy.actions, DiscreteActions)),
    )
    assert isinstance(read, MlpPolicy)
    expected = policy.act(observations)
    np.testing.assert_allclose(read.act(observations), expected, atol=2e-6)
    if isinstance(policy.actions, BoxActions):
        np.testing.assert_allclose(run.act(observations), expected, atol=2e-4, rtol=1e-3)


def test_the_metadata_says_order_scale_and_home(tmp_path):
    model = SAC("MlpPolicy", "Pendulum-v1", buffer_size=10, device="cpu")
    path = save_policy(
        model, tmp_path / "p.onnx", "IntegPendulum-v0", home=HOME,
        environment={"max_torque": 1.5}, seed=4,
    )  # fmt: skip
    card = onnx_card(path)
    assert card is not None
    assert card["observations"] == ["cos_theta", "sin_theta", "theta_dot"]
    assert (card["actions"], card["action_low"], card["action_high"]) == (["torque"], [-2.0], [2.0])
    home = {"engine": "native", "integrator": "explicit_euler", "dt": 0.05, "control_period": 0.1}
    assert card["home"] == home
    assert card["config"]["env_arguments"] == {**home, "max_torque": 1.5}
    assert (card["seed"], card["observation_statistics"]) == (4, None)


def test_a_zip_with_statistics_becomes_one_file_with_a_side_car(tmp_path, pendulum_zip):
    numbers = {"mean": [0.5, 0.0, 1.0], "var": [1.0, 2.0, 3.0], "epsilon": 1e-8, "clip_obs": 10.0}
    (tmp_path / "stats.json").write_text(json.dumps(numbers))
    path = save_policy(
        pendulum_zip, tmp_path / "p.safetensors", "IntegPendulum-v0", home=None,
        obs_stats=tmp_path / "stats.json",
    )  # fmt: skip
    policy, card = read_trained(path)
    expected = read_weights(pendulum_zip, None, tmp_path / "stats.json")
    assert policy.content_hash == expected.content_hash == card["content_hash"]
    assert card["home"] is None


class Foreign(nn.Module):
    """As deployed: a normalizer in the graph, SiLU, and a scale after tanh."""

    def __init__(self) -> None:
        super().__init__()
        layers = [nn.Linear(3, 16), nn.SiLU(), nn.Linear(16, 8), nn.SiLU(), nn.Linear(8, 1)]
        self.net = nn.Sequential(*layers)
        self.register_buffer("mean", torch.tensor([0.1, -0.2, 0.3]))
        self.register_buffer("std", torch.tensor([0.7, 0.8, 3.0]))

    def forward(self, observations):
        return 2.0 * torch.tanh(self.net((observations - self.mean) / (self.std + 1e-2)))


class Normed(nn.Module):
    """No feed-forward network of ours."""

    def __init__(self) -> None:
        super().__init__()
        self.net = nn.Sequential(nn.Linear(3, 8), nn.LayerNorm(8), nn.ReLU(), nn.Linear(8, 1))

    def forward(self, observations):
        return self.net(observations)


@pytest.mark.filterwarnings("ignore")  # of torch's exporter
@pytest.mark.parametrize("dynamo", [False, True])
@pytest.mark.parametrize(("module", "kind"), [(Foreign, MlpPolicy), (Normed, OnnxPolicy)])
def test_what_torch_exports_is_judged(module, kind, dynamo, tmp_path):
    torch.manual_seed(0)
    made, path = module(), tmp_path / "foreign.onnx"
    torch.onnx.export(made, (torch.zeros(1, 3),), path, dynamo=dynamo, verbose=False)
    assert (tmp_path / "foreign.onnx.data").exists() == dynamo
    policy = read_onnx(path)
    assert isinstance(policy, kind)
    observations = np.random.default_rng(0).normal(size=(40, 3)).astype(np.float32)
    expected = made(torch.as_tensor(observations)).detach().numpy()
    np.testing.assert_allclose(policy.act(observations), expected, atol=1e-5)
    again = pickle.loads(pickle.dumps(policy))
    np.testing.assert_array_equal(again.act(observations), policy.act(observations))


@pytest.mark.filterwarnings("ignore")  # of torch's exporter
@pytest.mark.parametrize("place", ["gone.data", "../foreign.data", "/dev/zero"])
def test_weights_of_an_onnx_file_lie_beside_it(place, tmp_path):
    (tmp_path / "inner").mkdir()
    (tmp_path / "foreign.data").write_bytes(bytes(4096))
    path = tmp_path / "inner" / "foreign.onnx"
    torch.onnx.export(Normed(), (torch.zeros(1, 3),), path, dynamo=False)
    model = onnx.load(path)
    for tensor in model.graph.initializer:
        onnx.external_data_helper.set_external_data(tensor, place)
        tensor.ClearField("raw_data")
    path.write_bytes(model.SerializeToString())
    with pytest.raises(PolicyFileError, match="no file beside it"):
        read_onnx(path)


class CleanActor(nn.Module):
    """CleanRL's actor of SAC."""

    def __init__(self) -> None:
        super().__init__()
        self.fc1, self.fc2 = nn.Linear(3, 16), nn.Linear(16, 16)
        self.fc_mean, self.fc_logstd = nn.Linear(16, 1), nn.Linear(16, 1)
        self.register_buffer("action_scale", torch.tensor([2.0]))
        self.register_buffer("action_bias", torch.tensor([0.5]))

    def forward(self, x):
        x = torch.relu(self.fc2(torch.relu(self.fc1(x))))
        return torch.tanh(self.fc_mean(x)) * self.action_scale + self.action_bias


def _clean_ppo(out: int, name: str) -> nn.Module:
    actor = nn.Sequential(nn.Linear(3, 8), nn.Tanh(), nn.Linear(8, 8), nn.Tanh(), nn.Linear(8, out))
    return nn.ModuleDict({"critic": nn.Linear(3, 1), name: actor})


@pytest.mark.parametrize("suffix", [".pt", ".pth", ".cleanrl_model"])
def test_state_dicts_of_cleanrl_with_a_side_car(suffix, tmp_path):
    torch.manual_seed(0)
    observations = np.random.default_rng(0).normal(size=(40, 3)).astype(np.float32)
    given, path = torch.as_tensor(observations), tmp_path / f"actor{suffix}"

    actor = CleanActor()
    torch.save((actor.state_dict(), {"critic": torch.zeros(1)}), path)
    with pytest.raises(PolicyFileError, match="holds weights alone; write its side-car"):
        read_weights(path)
    write_sidecar(path, "IntegPendulum-v0", home=HOME, activation="ReLU")
    policy, card = read_trained(path)
    np.testing.assert_allclose(policy.act(observations), actor(given).detach(), atol=1e-6)
    assert card["home"]["integrator"] == "explicit_euler"

    both = _clean_ppo(1, "actor_mean")
    torch.save(both.state_dict(), path)
    with pytest.raises(PolicyFileError, match="needs the bounds of its actions"):
        write_sidecar(path, "IntegPendulum-v0", home=HOME, activation="Tanh")
    write_sidecar(
        path, "IntegPendulum-v0", home=HOME, activation="Tanh", action_bounds=([-0.1], [0.1])
    )
    expected = both["actor_mean"](given).clamp(-0.1, 0.1).detach()
    np.testing.assert_allclose(read_trained(path)[0].act(observations), expected, atol=1e-6)

    both = _clean_ppo(2, "actor")
    torch.save(both.state_dict(), path)
    write_sidecar(path, "IntegCartPole-v0", home="stock", activation="Tanh", actions=2)
    expected = both["actor"](given).argmax(dim=1)
    np.testing.assert_array_equal(read_trained(path)[0].act(observations), expected)


@pytest.mark.filterwarnings("ignore")  # of torch's exporter
def test_what_would_be_executed_is_refused_with_the_way_that_works(tmp_path):
    (tmp_path / "policy.pkl").write_bytes(pickle.dumps({}))
    with pytest.raises(PolicyFileError, match=r"is a pickle.*torch\.onnx\.export"):
        read_weights(tmp_path / "policy.pkl")
    program = tmp_path / "program.pt"
    torch.jit.trace(nn.Linear(3, 1), torch.zeros(1, 3)).save(program)
    with pytest.raises(PolicyFileError, match="TorchScript program, which is never run; export"):
        write_sidecar(program, "IntegPendulum-v0", home=None, activation="Tanh")
    with pytest.raises(PolicyFileError, match="TorchScript program, which is never run; export"):
        read_weights(program)
    whole = tmp_path / "whole.pt"
    torch.save(nn.Linear(3, 1), whole)
    with pytest.raises(PolicyFileError, match="something other than plain weights"):
        write_sidecar(whole, "IntegPendulum-v0", home=None, activation="Tanh")
    (tmp_path / "x.onnx").write_bytes(b"nothing")
    with pytest.raises(PolicyFileError, match="is not a readable ONNX file"):
        read_weights(tmp_path / "x.onnx")


def test_only_what_is_feed_forward_is_saved_under_known_suffixes(tmp_path):
    model = DQN("MlpPolicy", "CartPole-v1", buffer_size=10, device="cpu")
    with pytest.raises(ValueError, match=r"saved as \.onnx or \.safetensors"):
        save_policy(model, tmp_path / "x.pt", "IntegCartPole-v0", home="stock")
    path = save_policy(model, tmp_path / "x.onnx", "IntegCartPole-v0", home="stock")
    assert isinstance(read_weights(path), MlpPolicy)
    kwargs = {"activation_fn": nn.PReLU}
    with pytest.raises(PolicyFileError, match="activation function"):
        save_policy(
            PPO("MlpPolicy", "CartPole-v1", policy_kwargs=kwargs), Path(tmp_path / "y.onnx"),
            "IntegCartPole-v0", home="stock",
        )  # fmt: skip


def test_a_policy_is_saved_with_its_side_car_s_statistics(tmp_path):
    model = PPO("MlpPolicy", "Pendulum-v1", n_steps=8, batch_size=8, device="cpu")
    model.save(tmp_path / "a.zip")
    stats = tmp_path / "stats.json"
    stats.write_text(
        json.dumps({"mean": [0.5] * 3, "var": [4.0] * 3, "epsilon": 1e-8, "clip_obs": 10.0})
    )
    write_sidecar(tmp_path / "a.zip", "IntegPendulum-v0", home=HOME, obs_stats=stats)
    expected, _ = read_trained(tmp_path / "a.zip")
    assert expected.statistics is not None
    for name in ("b.onnx", "b.safetensors"):
        path = save_policy(tmp_path / "a.zip", tmp_path / name, "IntegPendulum-v0", home=HOME)
        seen = np.random.default_rng(0).normal(size=(20, 3))
        np.testing.assert_allclose(read_weights(path).act(seen), expected.act(seen), atol=1e-6)
    before = (tmp_path / "a.json").read_bytes()
    with pytest.raises(ValueError, match=r"is the side-car of a\.zip; give the new file another"):
        save_policy(tmp_path / "a.zip", tmp_path / "a.safetensors", "IntegPendulum-v0", home=HOME)
    assert (tmp_path / "a.json").read_bytes() == before
    assert not (tmp_path / "a.safetensors").exists()


@pytest.mark.filterwarnings("ignore")  # of torch's exporter
def test_weights_beside_an_onnx_file_are_kept_with_it(tmp_path):
    torch.onnx.export(
        Foreign(), (torch.zeros(1, 3),), tmp_path / "F.ONNX", dynamo=True, verbose=False
    )
    _, _, files = read_policy_file(tmp_path / "F.ONNX")
    kept = tmp_path / "kept"
    kept.mkdir()
    for name, source in files.items():
        (kept / name).write_bytes(source.read_bytes())
    assert len(hashes_of(kept)) >= 1


def test_metadata_and_side_car_may_not_contradict(tmp_path):
    model = PPO("MlpPolicy", "Pendulum-v1", n_steps=8, batch_size=8, device="cpu")
    unknown, known = tmp_path / "u.onnx", tmp_path / "k.onnx"
    save_policy(model, unknown, "IntegPendulum-v0", home=None)
    write_sidecar(unknown, "IntegPendulum-v0", home=HOME)
    assert read_policy_file(unknown)[1]["home"]["integrator"] == "explicit_euler"
    save_policy(model, known, "IntegPendulum-v0", home="stock")
    write_sidecar(known, "IntegPendulum-v0", home=HOME)
    with pytest.raises(PolicyFileError, match="say different trainings"):
        read_policy_file(known)
