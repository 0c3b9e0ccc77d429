"""Policies of a user's own scripts of stable-baselines3, judged in one line each."""

import re
import shlex
import subprocess
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
from integ_gym.eval.panel.result import read_panel
from integ_gym.evidence.fields import VOLATILE_NAMES
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.policy_files.writing import save_policy, write_sidecar

PENDULUM = "IntegPendulum-v0"
SMALL = ["--episodes", "3", "--env-arg", "duration=2.0", "--workers", "1", "--no-progress"]
NAMING = {"record_id", "policy_hash", "content_hash", "run_id"}
"""What says which policy and which run it is; all else is what the policy did."""

OFF_POLICY = """
from stable_baselines3 import SAC

from integ_gym import save_policy

model = SAC("MlpPolicy", "Pendulum-v1", seed=0, learning_starts=50, device="cpu",
    policy_kwargs=dict(net_arch=[32, 32]))
model.learn(150)
model.save("zip/own.zip")
for ending in ("safetensors", "onnx"):
    save_policy("zip/own.zip", f"{ending}/own.{ending}", "IntegPendulum-v0", home="stock")
"""


def _run(script: str, folder: Path) -> None:
    (folder / "own.py").write_text(script)
    done = subprocess.run(
        [sys.executable, "own.py"], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def _evaluate(policy: Path, out: Path, *more: str) -> EvidenceStore:
    command = ["evaluate", str(policy), "--env", PENDULUM, "--out", str(out), *SMALL, *more]
    assert main(command) == 0
    return EvidenceStore(out / "evidence")


def _own(store: EvidenceStore) -> list:
    evaluated = [record for record in store.records() if record["phase"] == "evaluation"]
    records = [record for record in evaluated if record["policy_id"] == "own"]
    return sorted(records, key=lambda record: (record["cell"], record["episode_index"]))


@pytest.mark.slow
def test_one_policy_in_three_files_gives_equal_records(tmp_path):
    """But for its hash; onnxruntime's actions are equal within float32."""
    for ending in ("zip", "safetensors", "onnx"):
        (tmp_path / ending).mkdir()
    _run(OFF_POLICY, tmp_path)
    chosen = ("--home", "stock", "--integrator", "rk4", "--dt", "0.05")
    found = [
        _own(_evaluate(tmp_path / ending / f"own.{ending}", tmp_path / ending / "out", *chosen))
        for ending in ("zip", "safetensors", "onnx")
    ]
    assert len(found[0]) == 3 * len({record["cell"] for record in found[0]}) > 6
    for one, same, of_graph in zip(*found, strict=True):
        for name in one.fields.keys() - VOLATILE_NAMES - NAMING:
            assert one[name] == same[name], name
        assert one.trace.keys() == same.trace.keys() == of_graph.trace.keys()
        for name, values in one.trace.items():
            np.testing.assert_array_equal(values, same.trace[name], err_msg=name)
        assert of_graph["success"] == one["success"]
        assert of_graph["return"] == pytest.approx(one["return"], rel=1e-3)
    assert any(record.trace for record in found[0])
    torques = np.concatenate([record["torque_applied"] for record in found[0] if record.trace])
    assert np.ptp(torques) > 0.0


PAGE = (Path(__file__).parents[4] / "docs" / "how-to" / "policies.md").read_text(encoding="utf-8")
SHORT = ("--integrator", "rk4", "--dt", "0.01", "--episodes", "2", "--env-arg", "duration=0.5",
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
    assert main(["evaluate", *words, *SHORT]) == 0
    out = folder / words[words.index("--out") + 1]
    panel = read_panel(out / "panel.json")
    printed = capsys.readouterr()
    assert printed.err.startswith("home: ")
    assert printed.err.startswith("home: unknown") == (panel.rows[0].home is None)
    assert panel.headline.split()[:3] == printed.out.split()[:3]
    assert {entry.episodes for entry in panel.matrix} == {2}
    assert (out / "report.html").exists()
