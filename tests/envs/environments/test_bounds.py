"""Nothing leaves its declared bounds, and what cannot be started is refused when it is made."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

from integ_gym.envs import ENVIRONMENTS

COARSE = {"dt": 0.2, "control_period": 0.2}


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
@pytest.mark.parametrize("integrator", ["explicit_euler", "symplectic_euler", "implicit_euler"])
def test_every_observation_is_within_the_space(env_id, integrator):
    env = gym.make(env_id, integrator=integrator, **COARSE)
    lanes = gym.make_vec(env_id, 8, integrator=integrator, **COARSE)
    for made, count in ((env, 1), (lanes, 8)):
        observation, _ = made.reset(seed=1)
        for _ in range(60):
            if count == 1:
                observation, _, terminated, truncated, _ = made.step(made.action_space.sample())
                if terminated or truncated:
                    observation, _ = made.reset()
            else:
                observation, *_ = made.step(made.action_space.sample())
            assert made.observation_space.contains(observation)


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_a_speed_limit_below_the_starts_is_refused_when_it_is_made(env_id):
    for make in (gym.make, gym.make_vec):
        with pytest.raises(ValueError, match=r"below the speed of starts, which is up to .*; give"):
            make(env_id, max_speed=1e-3)


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
@pytest.mark.parametrize("value", [10**400, -(10**400)])
def test_a_number_that_no_float_holds_is_refused_or_falls_back(env_id, value):
    env, lanes = gym.make(env_id), gym.make_vec(env_id, 2)
    env.reset(seed=0)
    lanes.reset(seed=0)
    if isinstance(env.action_space, gym.spaces.Discrete):
        with pytest.raises(ValueError, match=r"action must be one of 0, 1, got -?1000") as refused:
            env.unwrapped.step(value)
        assert len(str(refused.value)) < 200
        *_, info = lanes.step([value, 0])
    else:
        *_, info = env.unwrapped.step([value])
        assert info["fallback_used"]
        *_, info = lanes.step([[value], [0.0]])
    np.testing.assert_array_equal(info["fallback_used"], [True, False])
