"""`integ-gym evaluate` on policies really trained on Gymnasium's own environments."""

import json
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch
from engine_cases import needs
from stable_baselines3 import PPO

from integ_gym.cli import main
from integ_gym.eval.panel.existing import plan
from integ_gym.eval.panel.policies import read_existing, row_name
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.policy_files.card import hashed
from integ_gym.train.policy_files.sidecar import has_sidecar


@pytest.fixture(scope="session")
def untrained_policy(tmp_path_factory) -> Path:
    """Of CartPole-v1 as well."""
    path = tmp_path_factory.mktemp("untrained") / "balance.zip"
    PPO("MlpPolicy", "CartPole-v1", seed=0, device="cpu").save(path)
    return path


@pytest.mark.parametrize(
    ("arguments", "fragment"),
    [
        (["--env", "IntegPendulum-v0"], "shape"),
        (["--env", "IntegCartPole-v0", "--integrator", "rk9"], "unknown integrator 'rk9'"),
        (["--env", "IntegCartPole-v0", "--dt", "-1"], "above 0"),
        (["--env", "IntegCartPole-v0", "--dt", "0.013"], "not a whole multiple"),
        (["--env", "IntegCartPole-v0", "--env-arg", "masss=1"], "unexpected keyword argument"),
        (
            ["--env", "IntegCartPole-v0", "--env-arg", "integrator=rk4"],
            "what the evaluation varies",
        ),
        (["--env", "IntegCartPole-v0", "--episodes", "0"], "--episodes must be 1 or above"),
    ],
)
def test_bad_input_leaves_nothing_behind(untrained_policy, tmp_path, capsys, arguments, fragment):
    out = tmp_path / "out"
    assert main(["evaluate", str(untrained_policy), "--out", str(out), *arguments]) == 2
    error = capsys.readouterr().err.strip()
    assert fragment in error
    assert error.count("\n") == 0
    assert not out.exists()


@pytest.mark.parametrize(
    ("given", "name"),
    [("best model (1)", "best-model-1"), ("random", "policy-random"), ("é", "policy")],
)
def test_row_names_are_usable_and_not_a_baselines(given, name):
    assert row_name(given) == name


def _with_card(tmp_path, panel_directory, change) -> Path:
    """A copy of a trained policy whose side-car, with its hash, says something else."""
    source = panel_directory / "policies" / "rk4-dt-0.05-seed0"
    (tmp_path / "mine.zip").write_bytes((source / "policy.zip").read_bytes())
    card = json.loads((source / "policy.json").read_text(encoding="utf-8"))
    change(card)
    (tmp_path / "mine.json").write_text(json.dumps(hashed(card)))
    return tmp_path / "mine.zip"


def test_a_side_car_runs_no_code_unasked(panel_directory, tmp_path, capsys, monkeypatch):
    (tmp_path / "stranger.py").write_text("raise SystemExit('run')\nclass X: step = None\n")
    monkeypatch.syspath_prepend(tmp_path)

    def name_code(card):
        card["config"]["env_arguments"]["integrator"] = "stranger:X"

    policy = _with_card(tmp_path, panel_directory, name_code)
    command = ["evaluate", str(policy), "--env", "IntegPendulum-v0", "--out", str(tmp_path / "o")]
    assert main(command) == 2
    error = capsys.readouterr().err
    assert "--own-code" in error
    assert error.count("\n") == 1
    with pytest.raises(SystemExit, match="run"):
        main([*command, "--own-code"])


def test_of_a_side_car_without_a_hash_that_is_said(panel_directory, tmp_path):
    policy = _with_card(tmp_path, panel_directory, lambda card: None)
    card = json.loads(policy.with_suffix(".json").read_text())
    del card["card_hash"]
    policy.with_suffix(".json").write_text(json.dumps(card | {"format": "integ-gym policy 1"}))
    existing = read_existing(policy, "IntegPendulum-v0", {})
    assert "an edit of it goes unseen" in str(existing.provenance)


def test_default_steps_divide_the_latency_of_the_training(panel_directory, tmp_path):
    def delay(card):
        card["config"]["env_arguments"] |= {"action_latency": 0.02, "dt": 0.01}

    policy = _with_card(tmp_path, panel_directory, delay)
    existing = read_existing(policy, "IntegPendulum-v0", {})
    spec = plan(existing, "IntegPendulum-v0", integrators=["rk4"])
    assert sorted(d.dt for d in spec.grid) == pytest.approx([0.0025, 0.005, 0.01])


def test_json_of_somebody_else_is_no_side_car(tmp_path):
    (tmp_path / "model.zip").write_bytes(b"")
    assert not has_sidecar(tmp_path / "model.zip")
    (tmp_path / "model.json").write_text('{"note": "mine"}')
    assert not has_sidecar(tmp_path / "model.zip")
    for text in ('{"format": "integ-gym policy 2"}', '{"content_hash": "0"}', "{", "[" * 100_000):
        (tmp_path / "model.json").write_text(text)
        assert has_sidecar(tmp_path / "model.zip")


@pytest.mark.slow
def test_cells_come_from_a_file_as_they_do_from_options(untrained_policy, tmp_path, capsys):
    command = ["evaluate", str(untrained_policy), "--env", "IntegCartPole-v0", "--no-progress"]
    command += ["--home", "integrator=rk4,dt=0.02,control_period=0.02", "--workers", "1"]
    options = ["--integrator", "rk4", "--dt", "0.02", "--dt", "0.01", "--episodes", "3"]
    options += ["--env-arg", "duration=1", "--at", "home", "--vary", "control_period=0.02,0.04"]
    assert main([*command, *options, "--out", str(tmp_path / "options")]) == 0
    spec = tmp_path / "cells.toml"
    spec.write_text(
        "episodes = 3\n[environment]\nduration = 1\n"
        '[[evaluate]]\nintegrator = "rk4"\ndt = [0.02, 0.01]\n'
        '[[evaluate]]\nat = "home"\ncontrol_period = [0.02, 0.04]\n'
    )
    assert main([*command, "--spec", str(spec), "--out", str(tmp_path / "file")]) == 0
    query = "SELECT record_id, content_hash FROM records ORDER BY ALL"
    one, other = (EvidenceStore(tmp_path / name / "evidence") for name in ("options", "file"))
    assert one.query(query).to_pydict() == other.query(query).to_pydict()
    spec.write_text(spec.read_text().replace("episodes = 3", "episodes = 3\nepisode_seed = 7"))
    assert main([*command, "--spec", str(spec), "--out", str(tmp_path / "starts")]) == 0
    assert EvidenceStore(tmp_path / "starts" / "evidence").query(query).num_rows > 20
    capsys.readouterr()
    again = [*command, "--spec", str(spec), "--out", str(tmp_path / "starts")]
    assert main([*again, "--dt", "0.02"]) == 2
    spec.write_text("[[evaluate]]\nintegrator = 'rk4'\n")
    assert main([*command, "--spec", str(spec), "--out", str(tmp_path / "no")]) == 2
    assert "evaluate[0]" in capsys.readouterr().err
    spec.write_text("[[evaluate]]\nat = 'home'\nmass_cart = 1.1\n")
    homeless = [part for part in command if part != "--home" and "=" not in part]
    assert main([*homeless, "--spec", str(spec), "--out", str(tmp_path / "no")]) == 2
    assert "home is unknown" in capsys.readouterr().err


def test_an_engine_without_the_integrators_asked_for_is_named(untrained_policy, tmp_path, capsys):
    command = ["evaluate", str(untrained_policy), "--env", "IntegCartPole-v0"]
    command += ["--integrator", "rk4", "--engine", "native", "--engine", "mujoco"]
    command += ["--out", str(tmp_path / "out")]
    assert main(command) == 2
    assert "mujoco has no integrator called rk4" in capsys.readouterr().err


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
    "does not divide": ("HalfCheetah-v5", ["--dt", "0.03"], "with `dt` 0.025 or 0.05 s"),
    "not a number": ("HalfCheetah-v5", ["--dt", "nan"], "`dt` must be a finite number above 0"),
    "no return": ("HalfCheetah-v5", ["--success-return", "nan"], "must be a finite number, got"),
    "unknown integrator": ("HalfCheetah-v5", ["--integrator", "euler"], "Did you mean 'Euler'"),
    "unknown argument": ("HalfCheetah-v5", ["--env-arg", "mass=2"], "Gymnasium cannot make"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_use_is_one_line_and_leaves_nothing(name, running, tmp_path, capsys):
    env_id, more, expected = WRONG[name]
    assert _evaluate(running, env_id, tmp_path / "out", *more) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert len(error.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()
