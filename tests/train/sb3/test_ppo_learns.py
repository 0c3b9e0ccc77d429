"""The PPO trainer learns."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from small_ppo import trained

from integ_gym.train.baselines import make_baseline
from integ_gym.train.policy_files.sidecar import read_trained
from integ_gym.train.ppo import PPOConfig

torch = pytest.importorskip("torch")
sb3 = pytest.importorskip("stable_baselines3")


def result_of(policy: Any, env_id: str, **arguments: Any) -> tuple[float, float]:
    """Success rate and mean return of 50 episodes under the policy's deterministic actions."""
    envs = gym.make_vec(env_id, 50, vectorization_mode="vector_entry_point", **arguments)
    observations, _ = envs.reset(seed=10_000)
    ended, success, returns = np.zeros(50, dtype=bool), np.zeros(50, dtype=bool), np.zeros(50)
    while not ended.all():
        observations, rewards, terminated, truncated, info = envs.step(policy.act(observations))
        returns += np.where(ended, 0.0, rewards)
        first = (terminated | truncated) & ~ended
        success[first] = info["success"][first]
        ended |= first
    return float(success.mean()), float(returns.mean())


@pytest.mark.slow
def test_learns_to_balance(tmp_path: Path) -> None:
    config = PPOConfig.of("IntegCartPole-v0", total_steps=35_000)
    policy, _ = read_trained(trained(config, tmp_path).policy)
    success, returned = result_of(policy, "IntegCartPole-v0", integrator="reference", dt=0.02)
    assert success >= 0.9
    assert returned >= 450.0  # random: 21


@pytest.mark.slow
def test_learns_to_swing_up(tmp_path: Path) -> None:
    """With torque to spare a short run is far better than chance; success takes a longer one."""
    arguments = {"integrator": "rk4", "dt": 0.05, "max_torque": 6.0, "start": "hanging"}
    config = PPOConfig.of(
        "IntegPendulum-v0",
        env_arguments=arguments,
        total_steps=50_000,
        n_steps=128,
        gae_lambda=0.9,
    )
    policy, _ = read_trained(trained(config, tmp_path).policy)
    _, returned = result_of(policy, "IntegPendulum-v0", **arguments)
    random_policy = make_baseline("random", setup_of(arguments))
    _, chance = result_of(random_policy, "IntegPendulum-v0", **arguments)
    assert returned > chance + 300.0  # about 750 here


def setup_of(arguments: dict[str, Any]) -> Any:
    return gym.make("IntegPendulum-v0", **arguments).unwrapped.setup  # type: ignore[attr-defined]
