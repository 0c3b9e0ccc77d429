"""Training with stable-baselines3: what is written, that it repeats itself, and how it fails."""

from __future__ import annotations

import json
import math
import os
import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import stable_baselines3 as sb3
import torch
from playing import play
from small_ppo import FLAGS, SMALL, WRITTEN, Recorder, files_of, looked_on, trained

from integ_gym.envs.integrators.rk4 import RK4
from integ_gym.envs.testbeds.making import make_training_environments
from integ_gym.train import ppo
from integ_gym.train.command import training_command as main
from integ_gym.train.config import TrainingConfig
from integ_gym.train.policy_files import sidecar
from integ_gym.train.policy_files.card import PolicyFileError
from integ_gym.train.policy_files.sidecar import read_sidecar, read_trained
from integ_gym.train.ppo import PPOConfig, model_to_bytes, train_run
from integ_gym.train.runs import ALGORITHMS, train_sac
from integ_gym.train.sac import SACConfig

SMALL_SAC = SACConfig(
    env_arguments=SMALL.env_arguments,
    seed=3,
    total_steps=90,
    n_envs=4,
    batch_size=16,
    learning_starts=40,
    net_arch=(16, 8),
)
SMALL_RUNS: dict[str, TrainingConfig] = {"ppo": SMALL, "sac": SMALL_SAC}
QUIET = {"progress": False, "tensorboard": False, "workers": 1}


@pytest.mark.parametrize("name", ALGORITHMS)
def test_a_policy_of_any_algorithm_is_what_its_library_reads(name, tmp_path):
    algorithm, config = ALGORITHMS[name], SMALL_RUNS[name]
    folders = [tmp_path / "one", tmp_path / "two", tmp_path / "three"]
    configs = [config, config, replace(config, seed=4)]
    one, two, three = algorithm.train(configs, folders, **QUIET)
    assert one.content_hash == two.content_hash != three.content_hash
    assert files_of(folders[0]) == WRITTEN
    assert one.card["algorithm"] == algorithm.config.algorithm
    assert one.card["policy_id"] == f"{name}-rk4-dt0.05-seed3"
    read = json.loads((folders[0] / "policy.json").read_text(encoding="utf-8"))
    assert algorithm.config(**read["config"]) == config

    model = getattr(sb3, algorithm.config.algorithm).load(one.policy, device="cpu")
    assert model.num_timesteps == one.card["steps"] == config.rounded_steps
    policy, _ = read_trained(one.policy)
    observations = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    expected, _ = model.predict(observations, deterministic=True)
    np.testing.assert_allclose(policy.act(observations), expected, rtol=0, atol=2e-6)


def test_sac_refuses_discrete_actions_before_anything_is_written(tmp_path):
    config = replace(SMALL_SAC, env_id="IntegCartPole-v0", env_arguments={})
    environments = make_training_environments("IntegCartPole-v0", {}, 1)
    environments.close()
    for refuse in (
        lambda: SACConfig.check_actions(environments.single_action_space),
        lambda: train_sac([config], [tmp_path / "no"], progress=False, tensorboard=False),
    ):
        with pytest.raises(ValueError, match=r"SAC needs continuous actions, got Discrete"):
            refuse()
    assert files_of(tmp_path) == set()


def test_sidecar_says_how_the_policy_came_about(small):
    (log,) = files_of(small.policy.parent) - WRITTEN
    assert log.startswith("tensorboard/events.out.tfevents")
    card = read_sidecar(small.policy)
    assert card == json.loads(json.dumps(dict(small.card)))
    assert PPOConfig(**card["config"]) == SMALL
    assert card["discretization"] == {
        "engine": "native",
        "engine_version": card["versions"]["integ-gym"],
        "integrator": "rk4",
        "dt": 0.05,
        "control_period": 0.05,
    }
    setup = gym.make("IntegPendulum-v0", **SMALL.env_arguments).unwrapped.setup
    assert card["env_arguments"] == setup.arguments()
    assert card["units"]["max_torque"] == "N m"
    assert card["action_bounds"] == [[float(np.float32(-0.8))], [float(np.float32(0.8))]]
    assert card["derived"]["gamma"] == pytest.approx(math.exp(-0.05), rel=1e-15)
    assert (card["mixture"], card["seed"], card["steps"]) == (None, 3, 512)
    assert card["last_episodes"]["episodes"] == 8  # 4 environments, 128 steps, 50 per episode
    assert card["last_episodes"]["success_rate"] == 0.0
    assert set(card["versions"]) >= {"integ-gym", "gymnasium", "numpy", "torch"}
    for place in (Path.home(), small.policy.parent):
        assert str(place) not in small.sidecar.read_text()


def test_rewards_are_scaled_for_the_learner_only(tmp_path, monkeypatch):
    seen = looked_on(monkeypatch, Recorder)
    config = replace(SMALL, reward_scale=1e-6)
    policy = trained(config, tmp_path)
    (recorder,) = seen
    rewards = np.array(recorder.rewards)
    assert rewards.shape == (128, 4)
    assert rewards.min() < -9.0  # near -π² while hanging
    episodes = rewards[:100].reshape(2, 50, 4).sum(axis=1)
    assert policy.card["last_episodes"]["return_mean"] == pytest.approx(episodes.mean(), rel=1e-5)
    assert recorder.closed_by_trainer
    env = gym.make("IntegPendulum-v0", **config.env_arguments)
    env.reset(seed=config.first_lane_seed + 2)
    np.testing.assert_array_equal(recorder.starts[0][2], env.unwrapped.state)


def test_discrete_actions_and_options_of_the_learner(tmp_path):
    options = {"learning_rate_end": 0.0, "activation": "ReLU", "target_kl": 0.01}
    config = replace(SMALL, env_id="IntegCartPole-v0", env_arguments={}, total_steps=256, **options)
    read, card = read_trained(trained(config, tmp_path).policy)
    assert card["action_bounds"] is None
    assert read.activation == "ReLU"
    assert read.act(np.zeros((3, 4))).dtype == np.int64


def test_every_hyperparameter_that_matters_changes_the_weights(tmp_path):
    changes: list[dict[str, Any]] = [
        {},
        {"reward_scale": 0.2},
        {"discount_time": 0.5},
        {"gae_lambda": 0.5},
        {"learning_rate_end": 1e-5},
    ]
    short = replace(SMALL, total_steps=256, n_epochs=1)
    hashes = {
        trained(replace(short, **change), tmp_path / str(place)).content_hash
        for place, change in enumerate(changes)
    }
    assert len(hashes) == len(changes)


@pytest.fixture
def two_threads():
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


@pytest.mark.usefixtures("two_threads")
def test_steps_are_told_and_nothing_outside_the_run_changes(small, tmp_path):
    jax = pytest.importorskip("jax")

    def outside():
        return [
            torch.get_num_threads(),
            torch.get_rng_state().tolist(),
            torch.are_deterministic_algorithms_enabled(),
            random.getstate(),
            [x.tolist() if isinstance(x, np.ndarray) else x for x in np.random.get_state()],  # noqa: NPY002
            dict(os.environ),
            dict(jax.config.values),
            np.geterr(),
            os.getcwd(),
        ]

    torch.manual_seed(1)
    before, told = outside(), []
    policy = train_run(SMALL, tmp_path, report=lambda *news: told.append(news))
    assert outside() == before
    assert policy.content_hash == small.content_hash
    assert [steps for steps, _ in told] == [4] * 128
    assert told[49][1] == ""
    assert told[50][1].startswith("return −")


def test_an_interrupted_run_leaves_no_policy(tmp_path, monkeypatch, capsys):
    made = looked_on(monkeypatch, lambda env: Recorder(env, fail_at=70))
    assert main([*FLAGS, "--out", str(tmp_path), "--no-tensorboard", "--no-progress"]) == 130
    assert "interrupted; no policy was written" in capsys.readouterr().err
    assert files_of(tmp_path) == set()
    assert made[-1].closed_by_trainer


@pytest.mark.parametrize("replaced_before_the_end", [0, 1])
def test_a_run_killed_while_writing_leaves_no_sidecar(
    replaced_before_the_end, small, tmp_path, monkeypatch
):
    for path in (small.policy, small.sidecar):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    renamed: list[Any] = []
    replace_file = os.replace

    def killed(source, target):
        if len(renamed) == replaced_before_the_end:
            raise KeyboardInterrupt
        renamed.append(target)
        replace_file(source, target)

    monkeypatch.setattr(sidecar.os, "replace", killed)
    with pytest.raises(KeyboardInterrupt):
        trained(replace(SMALL, seed=9, total_steps=256), tmp_path, force=True)
    assert files_of(tmp_path) == {"policy.zip"}
    with pytest.raises(PolicyFileError, match="keep the side-car beside the policy"):
        read_trained(tmp_path / "policy.zip")


class Raising(RK4):
    """A user's integrator that fails on the way."""

    steps = 0
    kind: type[Exception] = KeyError

    def step(self, *arguments):
        Raising.steps += 1
        if Raising.steps > 5:
            raise self.kind("no such\nthing")
        return super().step(*arguments)


@pytest.mark.parametrize(("kind", "said"), [(KeyError, "'no such"), (ValueError, "no such")])
def test_an_integrator_that_fails_is_one_line_and_exit_code_2(
    kind, said, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(Raising, "steps", 0)
    monkeypatch.setattr(Raising, "kind", kind)
    own = ["--integrator", f"{__name__}:Raising"]
    assert main([*FLAGS, *own, "--out", str(tmp_path), "--no-tensorboard", "--no-progress"]) == 2
    error = capsys.readouterr().err
    assert f"the integrator '{__name__}:Raising' failed: {kind.__name__}: {said}" in error
    assert error.count("\n") == 1
    assert files_of(tmp_path) == set()


@pytest.mark.parametrize("own", [False, True])
def test_a_wrapper_that_fails_is_not_blamed_on_an_integrator(own, tmp_path, monkeypatch):
    class Failing(Recorder):
        def step(self, actions):
            raise KeyError("a mistake of its own")

    looked_on(monkeypatch, Failing)
    chosen = {**SMALL.env_arguments, "integrator": f"{__name__}:Raising" if own else "rk4"}
    with pytest.raises(KeyError, match="a mistake of its own"):
        trained(replace(SMALL, env_arguments=chosen), tmp_path)


@pytest.mark.parametrize("last", [False, True])
def test_weights_that_overflow_are_told_with_the_remedy(last, tmp_path, monkeypatch, capsys):
    """On the way, or in the last update, which nothing is computed from before it is written."""

    def with_overflow(model):
        with torch.no_grad():
            next(model.policy.mlp_extractor.parameters()).fill_(math.inf)
        return model_to_bytes(model)

    if last:
        monkeypatch.setattr(ppo, "model_to_bytes", with_overflow)
    flags = [*FLAGS, "--learning-rate", "1e-3" if last else "1e6"]
    assert main([*flags, "--out", str(tmp_path), "--no-tensorboard", "--no-progress"]) == 2
    error = capsys.readouterr().err
    assert "finite" in error
    assert "lower" in error
    assert error.count("\n") == 1
    assert files_of(tmp_path) == set()


@pytest.mark.slow
def test_learns_to_balance(tmp_path):
    config = PPOConfig.of("IntegCartPole-v0", total_steps=35_000)
    policy, _ = read_trained(trained(config, tmp_path).policy)
    result = play("IntegCartPole-v0", policy, integrator="reference", dt=0.02)
    assert result.success >= 0.9
    assert result.returns.mean() >= 450.0  # random: 21
