"""`integ-gym evaluate` on Gymnasium's MuJoCo tasks, with policies of the stock tasks."""

from __future__ import annotations

import json
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch
from engine_cases import needs
from stable_baselines3 import PPO

from integ_gym.cli import main
from integ_gym.evidence.store import EvidenceStore

EPISODES = 4
HOME = "mujoco RK4 dt=0.02"
CELLS = [f"mujoco {name} dt={dt}" for name in ("Euler", "implicitfast") for dt in ("0.02", "0.01")]


@pytest.fixture(autouse=True)
def _mujoco(tmp_path, monkeypatch):
    """In a folder of its own: MuJoCo's compiler writes a file where it has a remark on a model."""
    needs("mujoco")
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="session")
def balancing(made_once) -> Path:
    """Trained on the stock InvertedPendulum-v5, clearly better than random there."""
    needs("mujoco")

    def make(folder: Path) -> None:
        torch.set_num_threads(1)
        given = {"n_steps": 512, "learning_rate": 1e-3, "seed": 0, "device": "cpu"}
        model = PPO("MlpPolicy", "InvertedPendulum-v5", **given)
        model.learn(15_360)
        model.save(folder / "balance.zip")

    return made_once("inverted_pendulum", make) / "balance.zip"


@pytest.fixture(scope="session")
def running(tmp_path_factory) -> Path:
    """For HalfCheetah-v5, not trained at all."""
    needs("mujoco")
    path = tmp_path_factory.mktemp("cheetah") / "run.zip"
    PPO("MlpPolicy", "HalfCheetah-v5", seed=0, device="cpu").save(path)
    return path


def _evaluate(policy: Path, env_id: str, out: Path, *more: str) -> int:
    command = ["evaluate", str(policy), "--env", env_id, "--out", str(out), "--no-progress"]
    command += ["--home", "stock"]
    return main([*command, "--episodes", str(EPISODES), *more])


@pytest.fixture(scope="session")
def run(balancing) -> Path:
    out = balancing.parent / "out"
    chosen = [f"--integrator={name}" for name in ("Euler", "implicitfast")]
    chosen += ["--dt=0.02", "--dt=0.01", "--no-limit"]
    assert _evaluate(balancing, "InvertedPendulum-v5", out, *chosen) == 0
    return out


def _panel(out: Path) -> dict:
    return json.loads((out / "panel.json").read_text(encoding="utf-8"))


def _column(out: Path, name: str, policy: str, cell: str) -> list:
    query = (
        f"SELECT \"{name}\" AS x FROM records WHERE policy_id = '{policy}' AND cell = '{cell}' "
        "AND phase = 'evaluation' "
        "ORDER BY episode_index"
    )
    return EvidenceStore(out / "evidence").query(query).column("x").to_pylist()


@pytest.mark.slow
def test_at_home_it_is_what_stable_baselines3_gets_in_the_stock_task(run, balancing):
    """Same policy, same seeds: the same returns, and better than random's.

    A fall may come a few steps earlier or later where rounding differs, hence two per cent.
    """
    model, stock = PPO.load(balancing, device="cpu"), gym.make("InvertedPendulum-v5")
    expected = []
    for seed in range(1000, 1000 + EPISODES):
        observation, _ = stock.reset(seed=seed)
        total, ended = 0.0, False
        while not ended:
            action, _ = model.predict(observation, deterministic=True)
            observation, reward, terminated, truncated, _ = stock.step(action)
            total, ended = total + float(reward), terminated or truncated
        expected.append(total)
    np.testing.assert_allclose(_column(run, "return", "balance", HOME), expected, rtol=0.02)
    assert np.mean(expected) > 2.0 * np.mean(_column(run, "return", "random", HOME))


@pytest.mark.slow
def test_starts_are_paired_and_the_cells_differ(run):
    """MuJoCo's Euler takes damping implicitly, which is all that implicitfast does here."""
    starts = {
        tuple(map(str, _column(run, "initial_state", policy, cell)))
        for policy in ("balance", "random", "zero")
        for cell in (*CELLS, HOME)
    }
    assert len(starts) == 1
    energies = {cell: tuple(_column(run, "energy_end", "zero", cell)) for cell in (*CELLS, HOME)}
    assert len(set(energies.values())) == 3
    for dt in ("0.02", "0.01"):
        assert energies[f"mujoco Euler dt={dt}"] == energies[f"mujoco implicitfast dt={dt}"]


@pytest.mark.slow
def test_says_where_survival_tells_nothing(running, tmp_path, capsys):
    short = ["--integrator=Euler", "--dt=0.01", "--env-arg", "max_episode_steps=20"]
    assert _evaluate(running, "HalfCheetah-v5", tmp_path / "survival", *short) == 0
    assert "give --success-return R" in capsys.readouterr().err
    survival = _panel(tmp_path / "survival")
    assert "calls the task solved at 4800" in survival["doubts"][-1]
    assert {entry["success"]["estimate"] for entry in survival["matrix"]} == {1.0}

    assert _evaluate(running, "HalfCheetah-v5", tmp_path / "r", "--success-return=0", *short) == 0
    returns = _panel(tmp_path / "r")
    assert not any("--success-return" in warning for warning in returns["doubts"])
    for entry in returns["matrix"]:
        earned = np.array(_column(tmp_path / "r", "return", entry["row"], entry["cell"]))
        assert entry["success"]["estimate"] == np.mean(earned >= 0.0)


WRONG = {
    "another's spaces": ("CartPole-v1", [], "expects observations of shape (17,)"),
    "another's": ("MountainCar-v0", [], "is no MuJoCo task; give IntegAcrobot-v0, "),
    "other spaces": ("Hopper-v5", [], "expects observations of shape (17,)"),
    "does not divide": ("HalfCheetah-v5", ["--dt", "0.03"], "with `dt` 0.025 or 0.05 s"),
    "not a number": ("HalfCheetah-v5", ["--dt", "nan"], "`dt` must be a finite number above 0"),
    "backwards": ("HalfCheetah-v5", ["--dt=-0.002"], "`dt` must be a finite number above 0, got"),
    "no return": ("HalfCheetah-v5", ["--success-return", "nan"], "must be a finite number, got"),
    "unknown integrator": ("HalfCheetah-v5", ["--integrator", "euler"], "Did you mean 'Euler'"),
    "varied": ("HalfCheetah-v5", ["--env-arg", "dt=0.01"], "is what the evaluation varies"),
    "unknown argument": ("HalfCheetah-v5", ["--env-arg", "mass=2"], "Gymnasium cannot make"),
    "ours": ("IntegPendulum-v0", ["--success-return", "1"], "--success-return is for Gymnasium's"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_use_is_one_line_and_leaves_nothing(name, running, tmp_path, capsys):
    env_id, more, expected = WRONG[name]
    assert _evaluate(running, env_id, tmp_path / "out", *more) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert len(error.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()
