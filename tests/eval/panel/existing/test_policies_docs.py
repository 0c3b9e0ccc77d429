"""The commands of docs/how-to/policies.md, one for each kind of policy, run as they are written."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from stable_baselines3 import A2C, DQN, PPO, SAC, TD3
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecNormalize
from torch import nn

from integ_gym.cli import main
from integ_gym.commands.evaluate import parser
from integ_gym.eval.panel.existing import plan
from integ_gym.eval.panel.policies import given_policy, read_existing
from integ_gym.eval.panel.result import read_panel
from integ_gym.train.policy_files.writing import save_policy, write_sidecar

PENDULUM = "IntegPendulum-v0"
PAGE = (Path(__file__).parents[4] / "docs" / "how-to" / "policies.md").read_text(encoding="utf-8")
SMALL = ("--integrator", "rk4", "--dt", "0.01", "--episodes", "2", "--env-arg", "duration=0.5",
         "--workers", "1", "--no-progress")  # fmt: skip


def _commands() -> list[list[str]]:
    blocks = re.findall(r"^```sh\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)
    lines = "".join(blocks).replace("\\\n", " ").splitlines()
    return [shlex.split(line, comments=True)[2:] for line in lines]


COMMANDS = _commands()


def _sb3(algorithm: type, env_id: str = "Pendulum-v1") -> Callable[[Path], None]:
    replay = {} if algorithm in (PPO, A2C) else {"buffer_size": 10}
    return lambda path: algorithm("MlpPolicy", env_id, seed=0, device="cpu", **replay).save(path)


def _statistics(path: Path) -> None:
    env = VecNormalize(make_vec_env("Pendulum-v1", 1))
    env.obs_rms.update(np.random.default_rng(0).normal(0.5, 2.0, size=(100, 3)))
    env.save(path)


def _saved(path: Path) -> None:
    model = PPO("MlpPolicy", "Pendulum-v1", seed=0, device="cpu")
    save_policy(model, path, PENDULUM, home="integrator=rk4,dt=0.05")


def _exported(path: Path) -> None:
    torch.onnx.export(nn.Linear(3, 1), (torch.zeros(1, 3),), path, dynamo=False)


def _cleanrl(path: Path) -> None:
    nets = nn.ModuleDict({"actor_mean": nn.Sequential(nn.Linear(3, 8), nn.Tanh(), nn.Linear(8, 1))})
    torch.save(nets.state_dict(), path)
    bounds = ([-2.0], [2.0])
    write_sidecar(
        path, PENDULUM, home="stock", activation="Tanh", action_bounds=bounds, obs_stats=False
    )


FILES: dict[str, Callable[[Path], None]] = {
    "policy.zip": _sb3(PPO),
    "ppo.zip": _sb3(PPO),
    "sac.zip": _sb3(SAC),
    "td3.zip": _sb3(TD3),
    "dqn.zip": _sb3(DQN, "CartPole-v1"),
    "a2c.zip": _sb3(A2C),
    "vecnormalize.pkl": _statistics,
    "saved.safetensors": _saved,
    "saved.onnx": _saved,
    "exported.onnx": _exported,
    "agent.cleanrl_model": _cleanrl,
}


@pytest.fixture
def folder(tmp_path, monkeypatch, request):
    """The files that a command names, and a module of one's own, in the current folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "my_policies", raising=False)
    (tmp_path / "my_policies.py").write_text("def act(seen):\n    return [-seen[1]]\n")
    for word in request.getfixturevalue("words"):
        if word in FILES:
            FILES[word](tmp_path / word)
    return tmp_path


def _name(words: list[str]) -> str:
    return " ".join(words[:2])


@pytest.mark.filterwarnings("ignore")  # of torch's exporter
@pytest.mark.parametrize("words", COMMANDS, ids=_name)
def test_a_documented_command_reads_its_policy_and_plans(words, folder):
    told = parser().parse_args(words)
    if told.policy:
        existing = given_policy(told.policy, told.env, {}, told.home)
    else:
        existing = read_existing(told.file, told.env, {}, told.obs_stats, home=told.home)
    assert (existing.home is None) == (told.home == "control_period=0.05")
    spec = plan(existing, told.env)
    assert len(spec.columns()) > 10
    assert spec.episodes == (told.episodes or 50)


RUN = [
    next(words for words in COMMANDS if any(word.endswith(ending) for word in words))
    for ending in (".pkl", ".cleanrl_model", ".onnx", ":act")
]
"""One for each way in which a policy acts: with statistics, layers, a graph, and a function."""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of torch's exporter
@pytest.mark.parametrize("words", RUN, ids=_name)
def test_a_documented_command_runs(words, folder, capsys):
    """With few cells and starts, and episodes that end soon."""
    assert main(["evaluate", *words, *SMALL]) == 0
    out = folder / words[words.index("--out") + 1]
    panel = read_panel(out / "panel.json")
    printed = capsys.readouterr()
    assert printed.err.startswith("home: ")
    assert printed.err.startswith("home: unknown") == (panel.rows[0].home is None)
    assert panel.headline.split()[:3] == printed.out.split()[:3]
    assert {entry.episodes for entry in panel.matrix} == {2}
    assert (out / "report.html").exists()
