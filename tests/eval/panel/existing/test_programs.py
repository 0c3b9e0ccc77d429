"""Programs as policies: memory of an episode, named parts of observations, consent to run them."""

from __future__ import annotations

import pickle
import random
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium import spaces
from house import ROOT
from torch import nn

import integ_gym
from integ_gym.envs.testbeds.gym_testbed import Applied
from integ_gym.eval.panel.policies import ActingIn, given_policy, read_existing
from integ_gym.evidence.replaying import replay_some
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.policy import start_acting
from integ_gym.train.policy_files.card import PolicyFileError
from integ_gym.train.policy_files.writing import write_sidecar

PENDULUM, MONOPED = "IntegPendulum-v0", "examples.robots.monoped:Monoped"
ARGUMENTS = {"name": "inverted_pendulum.xml"}
"""Of the robot below."""


class Recurrent(nn.Module):
    """As rsl_rl exports its LSTM to ONNX, memory in and out."""

    def __init__(self, inputs=3, outputs=1):
        super().__init__()
        torch.manual_seed(0)
        self.rnn, self.mlp = nn.LSTM(inputs, 8), nn.Linear(8, outputs)

    def forward(self, obs, h_in, c_in):
        x, (h, c) = self.rnn(obs.unsqueeze(0), (h_in, c_in))
        return self.mlp(x.squeeze(0)), h, c


class Buffered(nn.Module):
    """As rsl_rl exports it to TorchScript, memory in buffers; here of ones when it is saved."""

    def __init__(self):
        super().__init__()
        self.inner = Recurrent()
        for name in ("hidden_state", "cell_state"):
            self.register_buffer(name, torch.ones(1, 1, 8))

    def forward(self, obs):
        out, h, c = self.inner(obs, self.hidden_state, self.cell_state)
        self.hidden_state[:], self.cell_state[:] = h, c
        return out

    @torch.jit.export
    def reset(self) -> None:
        self.hidden_state[:], self.cell_state[:] = 0.0, 0.0


def _export(module, path, given, inputs, outputs):
    torch.onnx.export(
        module, given, path, input_names=inputs, output_names=outputs, dynamo=False, verbose=False
    )


def _recurrent(path, inputs=3, outputs=1):
    memory = torch.zeros(1, 1, 8)
    _export(
        Recurrent(inputs, outputs), path, (torch.zeros(1, inputs), memory, memory),
        ["obs", "h_in", "c_in"], ["actions", "h_out", "c_out"],
    )  # fmt: skip
    return path


def _remembered(observation, state=None):
    sums = observation if state is None else state + observation
    return [np.tanh(sums[1])], sums


def _given(form, tmp_path):
    if form == "onnx":
        return read_existing(_recurrent(tmp_path / "r.onnx"), PENDULUM, {}).policy
    if form == "torchscript":
        torch.jit.script(Buffered()).save(tmp_path / "r.pt")
        return read_existing(tmp_path / "r.pt", PENDULUM, {}, own_code=True).policy
    return given_policy(_remembered, PENDULUM, {}).policy


@pytest.mark.filterwarnings("ignore")  # of torch's exporter
@pytest.mark.parametrize("form", ["onnx", "torchscript", "callable"])
def test_every_lane_remembers_its_episode_and_nothing_before(form, tmp_path):
    policy = _given(form, tmp_path)
    seen = np.random.default_rng(0).normal(size=(6, 4, 3)).astype(np.float32)
    act = start_acting(policy)
    taken = np.array([act(observations) for observations in seen])
    if form == "callable":
        expected = np.tanh(seen.cumsum(axis=0)[..., 1:2])
    else:
        expected = []
        module, memory = Recurrent(), [torch.zeros(1, 4, 8)] * 2
        for observations in seen:
            out, *memory = module(torch.as_tensor(observations), *memory)
            expected.append(out.detach().numpy())
    np.testing.assert_allclose(taken, expected, atol=1e-6)
    act = start_acting(policy if form == "callable" else pickle.loads(pickle.dumps(policy)))
    alone = np.array([act(observations) for observations in seen[:, 2:3]])
    assert (alone[:, 0] == taken[:, 2]).all()
    assert (policy.act(seen[0]) == taken[0]).all()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of torch's exporter
@pytest.mark.parametrize(
    ("env_id", "inputs", "outputs", "given"),
    [(PENDULUM, 3, 1, {}), (MONOPED, 20, 3, {}), (f"{__name__}:Robot", 3, 1, ARGUMENTS)],
)
def test_recurrent_policies_are_replayed_to_the_last_bit(
    env_id, inputs, outputs, given, tmp_path, monkeypatch
):
    monkeypatch.syspath_prepend(str(ROOT))
    integ_gym.evaluate(
        _recurrent(tmp_path / "recurrent.onnx", inputs, outputs), env_id, tmp_path / "run",
        home="stock", integrators=["reference" if env_id == PENDULUM else "Euler"], episodes=3,
        environment={"duration": 1.0, **given}, limit=False, workers=1, progress=False,
        on_doubt=lambda doubt: None,
    )  # fmt: skip
    store = EvidenceStore(tmp_path / "run" / "evidence")
    acting = ActingIn(store, own_code=True)
    done = replay_some(
        store, None, random.Random(0), acting, decide=True, exact=True, own_code=True
    )
    assert not done.findings
    assert not any(done.skipped.values())
    own = [one for _, one in store.named_records() if one["policy_id"] == "recurrent"]
    assert len(own) >= 6
    assert done.exact >= len(own)


@pytest.mark.filterwarnings("ignore:.torch.jit.script")
def test_a_program_is_run_with_consent_alone(tmp_path):
    torch.jit.script(nn.Linear(3, 1)).save(tmp_path / "program.pt")
    write_sidecar(tmp_path / "program.pt", PENDULUM, home="stock")
    with pytest.raises(PolicyFileError, match=r"whose code would be run; .* --own-code"):
        read_existing(tmp_path / "program.pt", PENDULUM, {})
    existing = read_existing(tmp_path / "program.pt", PENDULUM, {}, own_code=True)
    assert existing.home
    assert existing.policy.act(np.zeros((2, 3))).shape == (2, 1)


class Asking(Buffered):
    """Its memory is reset of what it is told."""

    @torch.jit.export
    def reset(self, ended: torch.Tensor) -> None:
        self.hidden_state[:] = 0.0


@pytest.mark.filterwarnings("ignore:.torch.jit.script")
def test_a_program_whose_reset_asks_for_something_is_refused(tmp_path):
    torch.jit.script(Asking()).save(tmp_path / "asking.pt")
    write_sidecar(tmp_path / "asking.pt", PENDULUM, home="stock")
    with pytest.raises(PolicyFileError, match="`reset` asks for ended"):
        read_existing(tmp_path / "asking.pt", PENDULUM, {}, own_code=True)


class Parts(nn.Module):
    """Takes two parts of an observation."""

    def forward(self, speed, joint):
        return speed + 10.0 * joint[:, 1:]


class Named(gym.Env):
    """Observations by name, in another order than the network's inputs."""

    observation_space = spaces.Dict(
        joint=spaces.Box(-9.0, 9.0, (2,)), speed=spaces.Box(-9.0, 9.0, (1,))
    )
    action_space = spaces.Box(-1.0, 1.0, (1,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return {"joint": np.array([1.0, 2.0], np.float32), "speed": np.ones(1, np.float32)}, {}

    def step(self, action):
        return self.reset()[0], 1.0, False, False, {}


class Wrapped(integ_gym.GymTestbed):
    choices, home = ("euler",), integ_gym.Discretization("euler", 0.1, 0.1, "gymnasium")

    def build(self, discretization, **arguments):
        return gym.wrappers.TimeLimit(Named(), 5)

    def read(self, env):
        return Applied(self.home, 1)


class Robot(integ_gym.MjcfTestbed):
    control_period = 0.02

    def model(self, name):
        from gymnasium.envs.mujoco import mujoco_env

        return mujoco_env.expand_model_path(name)

    def observe(self, robot, memory, command):
        return {"joint": [1.0, 2.0], "speed": 1.0}

    def act(self, action, robot):
        return action


@pytest.mark.filterwarnings("ignore")  # of torch's exporter
def test_inputs_are_the_parts_of_an_observation_that_have_their_names(tmp_path):
    path = tmp_path / "parts.onnx"
    given = torch.zeros(1, 1), torch.zeros(1, 2)
    _export(Parts(), path, given, ["speed", "joint"], ["actions"])
    for kind, arguments in ((Wrapped, {}), (Robot, ARGUMENTS)):
        env_id = f"{__name__}:{kind.__name__}"
        policy = read_existing(path, env_id, arguments).policy
        assert policy.names == ("joint0", "joint1", "speed")
        assert policy.act(np.array([[1.0, 2.0, 3.0]])) == 23.0
        among = replace(policy, names=("spare", *policy.names))
        assert (among.act(np.array([[9.0, 1.0, 2.0, 3.0]] * 2)) == 23.0).all()
    with pytest.raises(PolicyFileError, match="takes the inputs speed, joint, and no part"):
        read_existing(path, PENDULUM, {})
