"""Policies written as safetensors and ONNX are the same policies; graphs of others are judged."""

import json
import pickle
import shutil
from itertools import pairwise

import numpy as np
import onnx
import pytest
import torch
from gymnasium import spaces
from hypothesis import given, settings
from hypothesis import strategies as st
from stable_baselines3 import DQN, PPO, SAC
from torch import nn

from integ_gym.eval.panel.policies import hashes_of, read_policy_file
from integ_gym.train.policy import (
    ACTIVATIONS,
    BoxActions,
    DiscreteActions,
    MlpPolicy,
    ObservationStatistics,
)
from integ_gym.train.policy_files.card import PolicyFileError
from integ_gym.train.policy_files.onnx import OnnxPolicy, onnx_bytes, onnx_card, read_onnx
from integ_gym.train.policy_files.reading import read_weights, unscaled
from integ_gym.train.policy_files.safetensors_file import read_safetensors, safetensors_bytes
from integ_gym.train.policy_files.sidecar import read_trained
from integ_gym.train.policy_files.writing import save_policy, write_sidecar

PENDULUM = "IntegPendulum-v0"
ATOL, RTOL = 1e-4, 1e-4
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
@settings(deadline=None, max_examples=20)
def test_both_files_hold_the_same_policy(scratch, policy):
    path = scratch / "policy.safetensors"
    path.write_bytes(safetensors_bytes(policy))
    assert read_safetensors(path).content_hash == policy.content_hash
    path = scratch / "policy.onnx"
    path.write_bytes(onnx_bytes(policy, {}))
    observations = 3.0 * np.random.default_rng(0).normal(size=(50, 3))
    run = OnnxPolicy(path.read_bytes(), isinstance(policy.actions, DiscreteActions))
    if isinstance(policy.actions, BoxActions):
        expected = policy.act(observations)
        np.testing.assert_allclose(run.act(observations), expected, atol=ATOL, rtol=RTOL)
        return
    outputs, chosen = np.sort(policy.outputs(observations)), run.act(observations)
    apart = outputs.shape[1] == 1 or outputs[:, -1] - outputs[:, -2] > ATOL
    assert (apart <= (chosen == policy.act(observations))).all()


def test_the_metadata_says_order_scale_and_home(tmp_path):
    model = SAC("MlpPolicy", "Pendulum-v1", buffer_size=10, device="cpu")
    path = save_policy(
        model, tmp_path / "p.onnx", PENDULUM, home=HOME,
        environment={"max_torque": 1.5}, seed=4,
    )  # fmt: skip
    card = onnx_card(path)
    assert card["observations"] == ["cos_theta", "sin_theta", "theta_dot"]
    assert (card["actions"], card["action_low"], card["action_high"]) == (["torque"], [-2.0], [2.0])
    home = {"engine": "native", "integrator": "explicit_euler", "dt": 0.05, "control_period": 0.1}
    assert card["home"] == home
    assert card["config"]["env_arguments"] == {**home, "max_torque": 1.5}
    assert (card["seed"], card["observation_statistics"]) == (4, None)


class Foreign(nn.Module):
    """As deployed: a normalizer in the graph, SiLU, and a scale after tanh."""

    def __init__(self):
        super().__init__()
        layers = [nn.Linear(3, 16), nn.SiLU(), nn.Linear(16, 8), nn.SiLU(), nn.Linear(8, 1)]
        self.net = nn.Sequential(*layers)
        self.register_buffer("mean", torch.tensor([0.1, -0.2, 0.3]))
        self.register_buffer("std", torch.tensor([0.7, 0.8, 3.0]))

    def forward(self, observations):
        return 2.0 * torch.tanh(self.net((observations - self.mean) / (self.std + 1e-2)))


class Normed(nn.Module):
    """No feed-forward network of ours."""

    def __init__(self):
        super().__init__()
        self.net = nn.Sequential(nn.Linear(3, 8), nn.LayerNorm(8), nn.ReLU(), nn.Linear(8, 1))

    def forward(self, observations):
        return self.net(observations)


@pytest.mark.filterwarnings("ignore")  # of torch's exporter
@pytest.mark.parametrize(
    ("module", "batches", "dynamo"),
    [(Foreign, False, True), (Foreign, True, False), (Normed, False, False), (Normed, True, True)],
)
def test_what_torch_exports_is_judged(module, batches, dynamo, tmp_path):
    torch.manual_seed(0)
    made, path = module(), tmp_path / "foreign.onnx"
    open_axes = {"dynamic_axes": {"x": {0: "n"}}, "input_names": ["x"]} if batches else {}
    torch.onnx.export(made, (torch.zeros(1, 3),), path, dynamo=dynamo, verbose=False, **open_axes)
    if dynamo:  # weights beside the file are kept with it
        assert (tmp_path / "foreign.onnx.data").exists()
        kept = tmp_path / "kept"
        kept.mkdir()
        for name, source in read_policy_file(path)[2].items():
            shutil.copy(source, kept / name)
        assert hashes_of(kept)
    policy = read_onnx(path)
    observations = np.random.default_rng(0).normal(size=(40, 3)).astype(np.float32)
    expected = made(torch.as_tensor(observations)).detach().numpy()
    np.testing.assert_allclose(policy.act(observations), expected, atol=1e-5)
    again = pickle.loads(pickle.dumps(policy))
    np.testing.assert_array_equal(again.act(observations), policy.act(observations))
    alone = np.concatenate([policy.act(one[None]) for one in observations])
    np.testing.assert_array_equal(policy.act(observations), alone)
    assert policy._of_batches is not None  # a graph for one observation is widened


@pytest.mark.filterwarnings("ignore")  # of torch's exporter
def test_statistics_are_put_in_front_of_a_graph(tmp_path):
    path, actor = tmp_path / "actor.onnx", nn.Linear(3, 1)
    torch.onnx.export(actor, (torch.zeros(1, 3),), path, dynamo=False)
    bare = read_weights(path)
    scaled = read_weights(path, obs_stats={"mean": [1.0, 2.0, 3.0], "var": [4.0] * 3})
    seen = np.random.default_rng(0).normal(size=(20, 3))
    expected = actor(torch.as_tensor(scaled.statistics.normalize(seen))).detach()
    np.testing.assert_allclose(scaled.act(seen), expected, atol=1e-6)
    assert bare.content_hash != scaled.content_hash
    with pytest.raises(PolicyFileError, match="is run as it is, and written in no other"):
        save_policy(path, tmp_path / "copy.safetensors", PENDULUM, home=HOME)


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

    def __init__(self):
        super().__init__()
        self.fc1, self.fc2 = nn.Linear(3, 16), nn.Linear(16, 16)
        self.fc_mean, self.fc_logstd = nn.Linear(16, 1), nn.Linear(16, 1)
        self.register_buffer("action_scale", torch.tensor([2.0]))
        self.register_buffer("action_bias", torch.tensor([0.5]))

    def forward(self, x):
        x = torch.relu(self.fc2(torch.relu(self.fc1(x))))
        return torch.tanh(self.fc_mean(x)) * self.action_scale + self.action_bias


def _clean_ppo(out, name):
    actor = nn.Sequential(nn.Linear(3, 8), nn.Tanh(), nn.Linear(8, 8), nn.Tanh(), nn.Linear(8, out))
    return nn.ModuleDict({"critic": nn.Linear(3, 1), name: actor})


def test_state_dicts_of_cleanrl_with_a_side_car(tmp_path):
    torch.manual_seed(0)
    observations = np.random.default_rng(0).normal(size=(40, 3)).astype(np.float32)
    given, path = torch.as_tensor(observations), tmp_path / "actor.pt"

    actor = CleanActor()
    torch.save((actor.state_dict(), {"critic": torch.zeros(1)}), path)
    with pytest.raises(PolicyFileError, match="holds weights alone; write its side-car"):
        read_weights(path)
    write_sidecar(path, PENDULUM, home=HOME, activation="ReLU")
    policy, card = read_trained(path)
    np.testing.assert_allclose(policy.act(observations), actor(given).detach(), atol=1e-6)
    assert card["home"]["integrator"] == "explicit_euler"

    both, path = _clean_ppo(1, "actor_mean"), tmp_path / "actor.pth"
    torch.save(both.state_dict(), path)
    with pytest.raises(PolicyFileError, match="needs the bounds of its actions"):
        write_sidecar(path, PENDULUM, home=HOME, activation="Tanh")
    write_sidecar(
        path, PENDULUM, home=HOME, activation="Tanh", action_bounds=([-0.1], [0.1]),
        obs_stats=False,
    )  # fmt: skip
    expected = both["actor_mean"](given).clamp(-0.1, 0.1).detach()
    np.testing.assert_allclose(read_trained(path)[0].act(observations), expected, atol=1e-6)

    both, path = _clean_ppo(2, "actor"), tmp_path / "actor.cleanrl_model"
    torch.save(both.state_dict(), path)
    write_sidecar(path, "IntegCartPole-v0", home="stock", activation="Tanh", actions=2)
    expected = both["actor"](given).argmax(dim=1)
    np.testing.assert_array_equal(read_trained(path)[0].act(observations), expected)


@pytest.mark.filterwarnings("ignore")  # of torch's exporter
def test_what_would_be_executed_is_refused_with_the_way_that_works(tmp_path):
    pickled, program, whole = (tmp_path / name for name in ("p.pkl", "program.pt", "whole.pt"))
    pickled.write_bytes(pickle.dumps({}))
    torch.jit.trace(nn.Linear(3, 1), torch.zeros(1, 3)).save(program)
    torch.save(nn.Linear(3, 1), whole)
    (tmp_path / "x.onnx").write_bytes(b"nothing")
    for path, message in (
        (pickled, r"is a pickle.*torch\.onnx\.export"),
        (tmp_path / "x.onnx", "is not a readable ONNX file"),
    ):
        with pytest.raises(PolicyFileError, match=message):
            read_weights(path)
    for path, message in (
        (program, "`activation` is for a state dict"),
        (whole, "something other than plain weights"),
    ):
        with pytest.raises(ValueError, match=message):
            write_sidecar(path, PENDULUM, home=None, activation="Tanh")


def test_checkpoints_of_trainings_say_what_works(tmp_path):
    path, tensors = tmp_path / "model_100.pt", {"0.weight": torch.zeros(1, 3)}
    more = {"optimizer_state_dict": {"state": {}}, "iter": 100}
    for held, message in (
        ({"actor_state_dict": tensors, **more}, r"checkpoint of rsl_rl.*export it to ONNX with"),
        ({"model_state_dict": tensors, **more}, r"checkpoint of rsl_rl.*export it to ONNX with"),
        ({"policy": tensors, "value": tensors}, r"of skrl.*with torch\.onnx\.export"),
        ({"actor": tensors, "value": tensors}, "with the parts actor, value; save the actor's"),
        ({"0.weight": torch.zeros(1, 3).double()}, "float32 weights; save the actor's state_dict"),
    ):
        torch.save(held, path)
        with pytest.raises(PolicyFileError, match=message):
            read_weights(path)


PPO_OF_CLEANRL = {
    "env_id": PENDULUM, "home": HOME, "activation": "Tanh", "action_bounds": (-2.0, 2.0),
}  # fmt: skip


def _written(path, module, **said):
    torch.save(module.state_dict(), path)
    write_sidecar(path, **{**PPO_OF_CLEANRL, **said})
    policy, card = read_trained(path)
    assert isinstance(policy, MlpPolicy)
    return policy, card


def test_cleanrl_s_ppo_without_its_statistics_is_warned_of(tmp_path):
    path = tmp_path / "agent.cleanrl_model"
    with pytest.warns(UserWarning, match=r"learns from normalized observations .* pass obs_stats="):
        _, card = _written(path, _clean_ppo(1, "actor_mean"))
    assert card["network"]["scaled"] is True
    assert unscaled(path, card)
    with pytest.raises(PolicyFileError, match=r"normalized observations .* pass obs_stats="):
        save_policy(path, tmp_path / "agent.onnx", PENDULUM, home=HOME)
    for said in ({"obs_stats": False}, {"obs_stats": {"mean": np.zeros(3), "var": np.ones(3)}}):
        _, card = _written(path, _clean_ppo(1, "actor_mean"), **said)
        assert not unscaled(path, card)
    for name in ("actor", "network"):  # of its scripts that do not normalize
        _, card = _written(path, _clean_ppo(2, name), actions=2, action_bounds=None)
        assert not unscaled(path, card)


def test_statistics_are_said_by_two_numbers_for_each_observation(tmp_path):
    path, actor = tmp_path / "agent.cleanrl_model", _clean_ppo(1, "actor_mean")
    mean, var = np.array([0.5, -0.5, 1.0]), np.array([[1.0, 2.0, 3.0]])
    policy, card = _written(path, actor, obs_stats={"mean": mean, "var": var})
    assert card["network"]["observation_statistics"] == {
        "mean": [0.5, -0.5, 1.0], "var": [1.0, 2.0, 3.0], "epsilon": 1e-8, "clip_obs": 10.0,
    }  # fmt: skip
    seen = np.random.default_rng(0).normal(size=(20, 3))
    normal = np.clip((seen - mean) / np.sqrt(var + 1e-8), -10.0, 10.0).astype(np.float32)
    expected = actor["actor_mean"](torch.as_tensor(normal)).clamp(-2.0, 2.0).detach()
    np.testing.assert_allclose(policy.act(seen), expected, atol=1e-6)
    with pytest.raises(PolicyFileError, match=r"^obs_stats: expected the keys mean, var.*; give"):
        _written(path, actor, obs_stats={"mean": mean})
    told = {"home": HOME, "obs_stats": {"mean": mean, "var": var}}
    with pytest.raises(PolicyFileError, match="has statistics of its own; leave out obs_stats"):
        save_policy(policy, tmp_path / "x.onnx", PENDULUM, **told)
    model = PPO("MlpPolicy", "Pendulum-v1", device="cpu")
    saved = save_policy(model, tmp_path / "m.safetensors", PENDULUM, **told)
    np.testing.assert_array_equal(read_trained(saved)[0].statistics.mean, mean)


def test_a_side_car_takes_numbers_arrays_and_spaces(tmp_path):
    path, actor = tmp_path / "agent.pt", _clean_ppo(2, "actor")
    space = spaces.Box(-2.0, 2.0, (1, 2))
    for bounds in ((-2.0, 2.0), ([-2.0, -2.0], 2), np.array([[-2.0, -2.0], [2.0, 2.0]]), space):
        policy, _ = _written(path, actor, action_bounds=bounds)
        assert policy.actions.low.tolist() == [-2.0, -2.0]
        assert policy.actions.high.tolist() == [2.0, 2.0]
    for actions in (2, np.int64(2), spaces.Discrete(2)):
        policy, card = _written(
            path, actor, actions=actions, action_bounds=None, seed=np.int64(3),
            home={"integrator": "rk4", "dt": np.float64(0.05)},
            environment={"length": np.float32(0.5)},
        )  # fmt: skip
        assert policy.actions == DiscreteActions(2)
        assert (card["seed"], card["config"]["env_arguments"]["length"]) == (3, 0.5)


@pytest.mark.parametrize(
    ("said", "fragment"),
    [
        ({"actions": 2}, "give `actions` or `action_bounds`"),
        ({"actions": 2.5, "action_bounds": None}, "is the number of discrete actions, such as 2"),
        ({"action_bounds": 2.0}, r"are \(low, high\), each one number for all actions"),
        ({"action_bounds": None}, r"action_bounds=\(low, high\)\) or \(\.\.\., actions=N\)"),
        ({"environment": {"dt": 0.1}}, "`dt` is a part of the home; say it in `home`"),
        ({"environment": {"mixture": []}}, "`mixture` is a part of the home"),
        ({"environment": {"length": {1.0}}}, "holds numbers, texts, lists and objects, got set"),
    ],
)
def test_what_a_side_car_cannot_say_is_one_sentence(said, fragment, tmp_path):
    with pytest.raises((TypeError, ValueError), match=fragment):
        _written(tmp_path / "agent.pt", _clean_ppo(2, "actor"), **said)
    assert not (tmp_path / "agent.json").exists()


def test_what_a_file_says_itself_is_not_said_beside_it(tmp_path, pendulum_zip):
    tensors = save_policy(pendulum_zip, tmp_path / "a.safetensors", PENDULUM, home=None)
    graph = save_policy(pendulum_zip, tmp_path / "b.onnx", PENDULUM, home=None)
    for path, said in (
        (pendulum_zip, {"activation": "Tanh"}),
        (pendulum_zip, {"actions": 2}),
        (tensors, {"action_bounds": (-2.0, 2.0)}),
        (graph, {"action_bounds": (-2.0, 2.0)}),
    ):
        with pytest.raises(ValueError, match=r"is for a state dict, and .* says its own; omit"):
            write_sidecar(path, PENDULUM, home=HOME, **said)
    with pytest.raises(TypeError, match="takes the path of a policy's file, got MlpPolicy; write"):
        write_sidecar(read_weights(tensors), PENDULUM, home=HOME)


class Wide(nn.Module):
    """A graph that is run, of 17 observations or of a row of 3."""

    def __init__(self, row=False):
        super().__init__()
        self.norm, self.last, self.row = nn.LayerNorm(3 if row else 17), nn.Linear(17, 1), row

    def forward(self, observations):
        return self.norm(observations)[:, 0, :1] if self.row else self.last(self.norm(observations))


@pytest.mark.filterwarnings("ignore")  # of torch's exporter
def test_a_graph_of_another_width_says_what_it_takes(tmp_path):
    torch.onnx.export(Wide(), (torch.zeros(1, 17),), tmp_path / "wide.onnx", dynamo=False)
    policy = read_onnx(tmp_path / "wide.onnx")
    box = spaces.Box(-1.0, 1.0, (3,))
    with pytest.raises(ValueError, match=r"input of shape \(1, 17\) and the environment gives"):
        policy.check_spaces(box, spaces.Box(-1.0, 1.0, (1,)))
    torch.onnx.export(Wide(True), (torch.zeros(1, 1, 3),), tmp_path / "row.onnx", dynamo=False)
    policy = read_onnx(tmp_path / "row.onnx")
    policy.check_spaces(box, spaces.Box(-1.0, 1.0, (1, 1)))
    assert policy.act(np.ones((5, 3))).shape == (5, 1)


def test_only_what_is_feed_forward_is_saved_under_known_suffixes(tmp_path):
    model = DQN("MlpPolicy", "CartPole-v1", buffer_size=10, device="cpu")
    with pytest.raises(ValueError, match=r"saved as \.onnx or \.safetensors"):
        save_policy(model, tmp_path / "x.pt", "IntegCartPole-v0", home="stock")
    path = save_policy(model, tmp_path / "x.onnx", "IntegCartPole-v0", home="stock")
    assert isinstance(read_weights(path), OnnxPolicy)


def test_a_policy_is_saved_with_its_side_car_s_statistics(tmp_path, pendulum_zip):
    source, stats = shutil.copy(pendulum_zip, tmp_path / "a.zip"), tmp_path / "stats.json"
    numbers = {"mean": [0.5, 0.0, 1.0], "var": [4.0, 2.0, 3.0], "epsilon": 1e-8, "clip_obs": 10.0}
    stats.write_text(json.dumps(numbers))
    write_sidecar(source, PENDULUM, home=HOME, obs_stats=stats)
    expected, _ = read_trained(source)
    assert expected.content_hash == read_weights(pendulum_zip, None, stats).content_hash
    for name in ("b.onnx", "b.safetensors"):
        path = save_policy(source, tmp_path / name, PENDULUM, home=HOME)
        seen = np.random.default_rng(0).normal(size=(20, 3))
        np.testing.assert_allclose(read_weights(path).act(seen), expected.act(seen), atol=1e-6)
    before = (tmp_path / "a.json").read_bytes()
    with pytest.raises(ValueError, match=r"is the side-car of a\.zip; give the new file another"):
        save_policy(source, tmp_path / "a.safetensors", PENDULUM, home=HOME)
    assert (tmp_path / "a.json").read_bytes() == before
    assert not (tmp_path / "a.safetensors").exists()


def test_metadata_and_side_car_may_not_contradict(tmp_path, pendulum_zip):
    unknown, known = tmp_path / "u.onnx", tmp_path / "k.onnx"
    for path, home in ((unknown, None), (known, "stock")):
        save_policy(pendulum_zip, path, PENDULUM, home=home)
        write_sidecar(path, PENDULUM, home=HOME)
    assert read_policy_file(unknown)[1]["home"]["integrator"] == "explicit_euler"
    with pytest.raises(PolicyFileError, match="describe different trainings"):
        read_policy_file(known)
