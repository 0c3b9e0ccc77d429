"""Every algorithm of stable-baselines3's: configured, trained, written and read alike."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_ppo import SMALL, WRITTEN, files_of

from integ_gym.envs.testbeds.making import make_training_environments
from integ_gym.train.command import training_command
from integ_gym.train.config import TrainingConfig
from integ_gym.train.policy_files.sidecar import read_trained
from integ_gym.train.runs import ALGORITHMS, train_sac
from integ_gym.train.sac import SACConfig

sb3 = pytest.importorskip("stable_baselines3")

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


@pytest.mark.parametrize("name", ALGORITHMS)
def test_a_policy_of_any_algorithm_is_what_its_library_reads(name: str, tmp_path: Path) -> None:
    algorithm, config = ALGORITHMS[name], SMALL_RUNS[name]
    folders = [tmp_path / "one", tmp_path / "two"]
    one, two = algorithm.train(
        [config, config], folders, progress=False, tensorboard=False, workers=1
    )
    assert one.content_hash == two.content_hash
    assert files_of(folders[0]) == WRITTEN
    assert one.card["algorithm"] == algorithm.config.algorithm
    assert one.card["steps"] == config.rounded_steps
    assert one.card["policy_id"] == f"{name}-rk4-dt0.05-seed3"
    read = json.loads((folders[0] / "policy.json").read_text(encoding="utf-8"))
    assert algorithm.config(**read["config"]) == config

    model = getattr(sb3, algorithm.config.algorithm).load(one.policy, device="cpu")
    assert model.num_timesteps == config.rounded_steps
    policy, _ = read_trained(one.policy)
    observations = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    expected, _ = model.predict(observations, deterministic=True)
    np.testing.assert_allclose(policy.act(observations), expected, rtol=0, atol=2e-6)


@pytest.mark.parametrize("name", ALGORITHMS)
def test_another_seed_is_another_policy(name: str, tmp_path: Path) -> None:
    configs = [replace(SMALL_RUNS[name], seed=seed) for seed in (1, 2)]
    folders = [tmp_path / "one", tmp_path / "two"]
    one, two = ALGORITHMS[name].train(
        configs, folders, progress=False, tensorboard=False, workers=1
    )
    assert one.content_hash != two.content_hash


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tau": 1.5}, "`tau` must be a number from 0 to 1, got 1.5"),
        ({"gradient_steps": -2}, "`gradient_steps` must be a whole number, -1 or above, got -2"),
        ({"buffer_size": 10**9}, "`buffer_size` must be a whole number, from 1 to 16777216"),
        ({"env_id": "IntegPendulm-v0"}, "unknown environment 'IntegPendulm-v0'. Did you mean"),
    ],
)
def test_impossible_values_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=r"^[^\n]*$") as caught:
        replace(SMALL_SAC, **changes)
    assert message in str(caught.value)


def test_discrete_actions_are_refused_before_anything_is_written(tmp_path: Path) -> None:
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


def test_the_command_takes_an_algorithm(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flags = ["--no-progress", "--no-tensorboard", "--duration", "1", "--out", str(tmp_path / "a")]
    sac = ["--algorithm", "sac", "--total-steps", "40", "--learning-starts", "20"]
    assert training_command([*sac, *flags]) == 0
    _, card = read_trained(tmp_path / "a" / "policy.zip")
    assert card["algorithm"] == "SAC"
    capsys.readouterr()
    assert training_command([*sac, *flags, "--force", "--trainer", "fleet"]) == 2
    assert "the fleet trains PPO; train SAC with --trainer sb3" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        training_command(["--algorithm", "sac", "--help"])
    shown = capsys.readouterr().out
    assert "--learning-starts" in shown
    assert "--n-epochs" not in shown
