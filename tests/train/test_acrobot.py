"""The acrobot's hand-made controllers solve the truth from nearly every start."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

from integ_gym.train.baselines import make_baseline

LANES = 40


@pytest.mark.parametrize("integrator", ["reference", "rk4"])
@pytest.mark.parametrize("env_id", ["IntegAcrobot-v0", "IntegAcrobotSwingUp-v0"])
def test_the_hand_made_controller_succeeds(env_id, integrator):
    envs = gym.make_vec(env_id, LANES, integrator=integrator)
    policy = make_baseline("handmade", envs.unwrapped.setup)
    observations, _ = envs.reset(seed=1)
    ended, succeeded = np.zeros(LANES, bool), np.zeros(LANES, bool)
    while not ended.all():
        observations, _, terminated, truncated, info = envs.step(policy.act(observations))
        succeeded |= info["success"] & ~ended
        ended |= terminated | truncated
    assert succeeded.mean() >= 0.9
