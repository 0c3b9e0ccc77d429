"""The PPO trainer: what it writes, and that it repeats itself."""

from __future__ import annotations

import json
import math
import os
import random
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from small_ppo import SMALL, WRITTEN, Recorder, files_of, looked_on, trained

from integ_gym.train.policy_files.sidecar import TrainedPolicy, read_sidecar, read_trained
from integ_gym.train.ppo import PPOConfig, train_run

torch = pytest.importorskip("torch")
sb3 = pytest.importorskip("stable_baselines3")


def test_files(small: TrainedPolicy) -> None:
    folder = small.policy.parent
    names = files_of(folder)
    assert names >= WRITTEN
    (log,) = names - WRITTEN
    assert log.startswith("tensorboard/events.out.tfevents")
    assert {path.name for path in folder.iterdir()} == WRITTEN | {"tensorboard"}


def test_sidecar_says_how_the_policy_came_about(small: TrainedPolicy) -> None:
    card = read_sidecar(small.policy)
    assert card == json.loads(json.dumps(dict(small.card)))
    assert PPOConfig(**card["config"]) == SMALL
    assert card["env_id"] == "IntegPendulum-v0"
    assert card["discretization"] == {
        "engine": "native",
        "engine_version": card["versions"]["integ-gym"],
        "integrator": "rk4",
        "dt": 0.05,
        "control_period": 0.05,
    }
    assert card["mixture"] is None
    setup = gym.make("IntegPendulum-v0", **SMALL.env_arguments).unwrapped.setup  # type: ignore[attr-defined]
    assert card["env_arguments"] == setup.arguments()
    assert card["units"]["max_torque"] == "N m"
    assert card["action_bounds"] == [[float(np.float32(-0.8))], [float(np.float32(0.8))]]
    assert card["derived"]["gamma"] == pytest.approx(math.exp(-0.05), rel=1e-15)
    assert card["derived"]["gae_lambda"] == SMALL.gae_lambda
    assert (card["seed"], card["steps"]) == (3, 512)
    assert card["wall_seconds"] > 0
    assert card["last_episodes"]["episodes"] == 8  # 4 environments, 128 steps, 50 per episode
    assert card["last_episodes"]["success_rate"] == 0.0
    assert -2000 < card["last_episodes"]["return_mean"] < 0
    assert set(card["versions"]) >= {"integ-gym", "gymnasium", "numpy", "torch"}
    assert str(Path.home()) not in small.sidecar.read_text()
    assert str(small.policy.parent) not in small.sidecar.read_text()


def test_rewards_are_scaled_for_the_learner_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
    assert files_of(tmp_path) == WRITTEN
    lanes = config.first_lane_seed
    env = gym.make("IntegPendulum-v0", **config.env_arguments)
    env.reset(seed=lanes + 2)
    np.testing.assert_array_equal(recorder.starts[0][2], env.unwrapped.state)  # type: ignore[attr-defined]


def test_steps_are_told_as_they_are_taken(small: TrainedPolicy, tmp_path: Path) -> None:
    told: list[tuple[int, str]] = []
    policy = train_run(SMALL, tmp_path, report=lambda *news: told.append(news))
    assert [steps for steps, _ in told] == [4] * 128
    assert told[49][1] == ""
    assert told[50][1].startswith("return -")
    assert policy.content_hash == small.content_hash


def test_a_mixture_is_told_apart(tmp_path: Path) -> None:
    mixture = [{"integrator": "rk4"}, {"integrator": "explicit_euler", "dt": 0.025}]
    arguments = {"control_period": 0.05, "duration": 0.5, "mixture": mixture}
    config = replace(SMALL, env_arguments=arguments, total_steps=256)
    policy = trained(config, tmp_path)
    assert policy.card["discretization"] is None
    assert [member["integrator"] for member in policy.card["mixture"]] == ["rk4", "explicit_euler"]
    assert [member["dt"] for member in policy.card["mixture"]] == [0.05, 0.025]
    assert policy.card["policy_id"] == "ppo-mixture-seed3"


def test_discrete_actions_and_options_of_the_learner(tmp_path: Path) -> None:
    config = replace(
        SMALL,
        env_id="IntegCartPole-v0",
        env_arguments={},
        total_steps=256,
        learning_rate_end=0.0,
        activation="ReLU",
        target_kl=0.01,
    )
    policy = trained(config, tmp_path)
    read, card = read_trained(policy.policy)
    assert card["action_bounds"] is None
    assert read.activation == "ReLU"
    assert read.act(np.zeros((3, 4))).dtype == np.int64


def test_seed_and_every_hyperparameter_that_matters_change_the_weights(
    small: TrainedPolicy, tmp_path: Path
) -> None:
    changes: list[dict[str, Any]] = [
        {"seed": 4},
        {"reward_scale": 0.2},
        {"discount_time": 0.5},
        {"gae_lambda": 0.5},
        {"learning_rate_end": 1e-5},
    ]
    hashes = {small.content_hash}
    for index, change in enumerate(changes):
        config = replace(SMALL, **change)
        folder = tmp_path / str(index)
        hashes.add(trained(config, folder).content_hash)
    assert len(hashes) == 1 + len(changes)


@pytest.fixture
def two_threads() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


@pytest.mark.usefixtures("two_threads")
def test_nothing_outside_the_run_changes(small: TrainedPolicy, tmp_path: Path) -> None:
    jax = pytest.importorskip("jax")

    def outside() -> list[Any]:
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
    before = outside()
    policy = trained(SMALL, tmp_path)
    assert outside() == before
    assert policy.content_hash == small.content_hash
