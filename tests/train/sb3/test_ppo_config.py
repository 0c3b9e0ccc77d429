"""The PPO trainer's configuration."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from small_ppo import SMALL

from integ_gym.train.ppo import PPOConfig


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"env_id": "IntegPendulm-v0"}, "unknown environment 'IntegPendulm-v0'. Did you mean"),
        ({"seed": -1}, "`seed` must be a whole number, from 0 to 4294967295, got -1"),
        ({"n_envs": 2.0}, "`n_envs` must be a whole number, from 1 to 65536, got 2.0"),
        ({"n_envs": 10**8}, "`n_envs` must be a whole number, from 1 to 65536, got 100000000"),
        ({"n_steps": 10**12}, "is kept in memory, and at most 16777216 are; give fewer"),
        ({"total_steps": 10**15}, "`total_steps` must be a whole number, from 1 to 1000000000000"),
        ({"batch_size": 96}, "`batch_size`=96 does not divide a rollout of `n_envs` × `n_steps`"),
        ({"learning_rate": 0.0}, "`learning_rate` must be a finite number above 0, got 0.0"),
        ({"gae_lambda": 1.5}, "`gae_lambda` must be a number from 0 to 1, got 1.5"),
        ({"discount_time": math.inf}, "`discount_time` must be a finite number above 0, got inf"),
        (
            {"net_arch": (64, 0)},
            "`net_arch` must be a list of at most 16 whole numbers, from 1 to 4096",
        ),
        ({"activation": "Sine"}, "`activation` must be one of 'Tanh'"),
        ({"env_arguments": [1]}, "`env_arguments` must map argument names to values"),
        ({"target_kl": -1}, "`target_kl` must be a finite number above 0, or None"),
        ({"reward_scale": True}, "`reward_scale` must be a finite number above 0, got True"),
    ],
)
def test_impossible_values_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError) as caught:
        replace(SMALL, **changes)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_discount_is_a_time_constant() -> None:
    config = PPOConfig(discount_time=2.0)
    assert config.discount(0.05) == pytest.approx(math.exp(-0.025), rel=1e-15)
    assert config.discount(0.1) == pytest.approx(config.discount(0.05) ** 2, rel=1e-15)


def test_lanes_of_neighbouring_seeds_do_not_overlap() -> None:
    seeds = sorted(PPOConfig(seed=seed).first_lane_seed for seed in range(1000))
    assert np.diff(seeds).min() > 1000
