"""Environments that are copied or pickled go on as the original does."""

from __future__ import annotations

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest

from integ_gym.envs import ENVIRONMENTS
from integ_gym.envs.episode.steps import WARM_UP

STEPS = 3 * WARM_UP
WAYS = {"copied": copy.deepcopy, "pickled": lambda env: pickle.loads(pickle.dumps(env))}


def _rollout(env, actions):
    """Observations and energies over steps; a single environment begins anew when it ends."""
    told = []
    for action in actions:
        observation, _, terminated, truncated, info = env.step(action)
        told.append(np.append(np.ravel(observation), np.ravel(info["energy"])))
        if not np.ndim(terminated) and (terminated or truncated):
            told.append(np.append(env.reset()[0], 0.0))
    return np.array(told)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("before", [1, WARM_UP + 1])
@pytest.mark.parametrize("arguments", [None, {}, {"compiled": True}], ids=str)
@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_a_copy_goes_on_alike(env_id, arguments, before, way):
    single = arguments is None
    env = gym.make(env_id) if single else gym.make_vec(env_id, num_envs=3, **arguments)
    env.reset(seed=1)
    env.action_space.seed(1)
    actions = [env.action_space.sample() for _ in range(STEPS)]
    _rollout(env, actions[:before])
    other = WAYS[way](env)
    np.testing.assert_array_equal(_rollout(other, actions), _rollout(env, actions))
