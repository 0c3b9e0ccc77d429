"""`integ-gym evaluate` on policies really trained on Gymnasium's own environments."""

from __future__ import annotations

import json
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy

from integ_gym.cli import main
from integ_gym.eval.panel.existing import plan
from integ_gym.eval.panel.policies import read_existing, row_name
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.policy_files.card import hashed
from integ_gym.train.policy_files.sidecar import has_sidecar


def _trained(env_id: str, steps: int, path: Path, **arguments) -> Path:
    torch.set_num_threads(1)
    model = PPO("MlpPolicy", env_id, seed=0, device="cpu", **arguments)
    model.learn(steps)
    model.save(path)
    return path


@pytest.fixture(scope="session")
def cart_pole_policy(made_once) -> Path:
    """ReLU, unequal nets; clearly better than random on CartPole-v1."""

    def make(folder: Path) -> None:
        nets = {"pi": [32, 16], "vf": [64]}
        kwargs = {"activation_fn": torch.nn.ReLU, "net_arch": nets}
        _trained("CartPole-v1", 12_288, folder / "balance.zip", policy_kwargs=kwargs)

    return made_once("cart_pole_policy", make) / "balance.zip"


@pytest.fixture(scope="session")
def untrained_policy(tmp_path_factory) -> Path:
    """Of CartPole-v1 as well."""
    path = tmp_path_factory.mktemp("untrained") / "balance.zip"
    PPO("MlpPolicy", "CartPole-v1", seed=0, device="cpu").save(path)
    return path


@pytest.fixture(scope="session")
def pendulum_policy(tmp_path_factory) -> Path:
    """gSDE, hardly trained; no better than random on Pendulum-v1."""
    return _trained(
        "Pendulum-v1", 1024, tmp_path_factory.mktemp("pendulum") / "swing.zip",
        use_sde=True, n_steps=512,
    )  # fmt: skip


@pytest.fixture(scope="session")
def cart_pole_run(cart_pole_policy, made_once) -> Path:
    command = ["evaluate", str(cart_pole_policy), "--env", "IntegCartPole-v0", "--no-progress"]

    def make(folder: Path) -> None:
        few = ["--integrator", "rk4", "--dt", "0.02", "--episodes", "10"]
        assert main([*command, *few, "--home", "stock", "--out", str(folder / "out")]) == 0

    return made_once("cart_pole_run", make) / "out"


@pytest.mark.slow
def test_home_replay_is_what_stable_baselines3_gets(cart_pole_policy, cart_pole_run):
    """Same policy, same seeds, Gymnasium's own environment: the same returns.

    A bang-bang policy may switch one step later where rounding differs, hence two per cent.
    """
    model, stock = PPO.load(cart_pole_policy), gym.make("CartPole-v1")
    expected = []
    for seed in range(1000, 1010):
        observation, _ = stock.reset(seed=seed)
        total, ended = 0.0, False
        while not ended:
            action, _ = model.predict(observation, deterministic=True)
            observation, reward, terminated, truncated, _ = stock.step(action)
            total, ended = total + reward, terminated or truncated
        expected.append(total)
    got = EvidenceStore(cart_pole_run / "evidence").query(
        "SELECT \"return\" AS r FROM records WHERE policy_id = 'balance' "
        "AND cell = 'explicit_euler dt=0.02' AND phase = 'evaluation' ORDER BY episode_index"
    )
    np.testing.assert_allclose(got.column("r").to_pylist(), expected, rtol=0.02)
    mean, _ = evaluate_policy(model, _monitored(), n_eval_episodes=5)
    assert mean > 50


def _monitored():
    from stable_baselines3.common.monitor import Monitor

    return Monitor(gym.make("CartPole-v1"))


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


def test_a_stock_policy_meets_the_pendulum_where_the_speed_is_limited(pendulum_policy):
    """Without a limit the observation space is another, and stable-baselines3 refuses."""
    with pytest.raises(ValueError, match="Observation spaces do not match"):
        PPO.load(pendulum_policy, env=gym.make("IntegPendulum-v0"))
    assert PPO.load(pendulum_policy, env=gym.make("IntegPendulum-v0", max_speed=8.0))


def test_json_of_somebody_else_is_no_side_car(tmp_path):
    (tmp_path / "model.zip").write_bytes(b"")
    assert not has_sidecar(tmp_path / "model.zip")
    (tmp_path / "model.json").write_text('{"note": "mine"}')
    assert not has_sidecar(tmp_path / "model.zip")
    for text in ('{"format": "integ-gym policy 2"}', '{"content_hash": "0"}', "{", "[" * 100_000):
        (tmp_path / "model.json").write_text(text)
        assert has_sidecar(tmp_path / "model.zip")


def test_a_file_that_is_no_policy_is_refused(tmp_path, capsys):
    (tmp_path / "x.zip").write_bytes(b"PK nothing")
    command = ["evaluate", str(tmp_path / "x.zip"), "--env", "IntegPendulum-v0"]
    assert main([*command, "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.startswith("integ-gym evaluate: ")
    assert not (tmp_path / "out").exists()


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
