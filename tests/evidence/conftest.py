"""Runs of recorded environments that several tests look at."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

import integ_gym  # noqa: F401
from integ_gym.evidence.labels import EpisodeContext
from integ_gym.evidence.recorder import RecordEvidence
from integ_gym.evidence.store import EvidenceStore


def _play(env, seeds, actions=None):
    """Play one episode per seed; what each instant and step gave, as the policy saw it."""
    played = []
    for seed in seeds:
        rng = np.random.default_rng([7, seed or 0])
        observation, info = env.reset(seed=seed)
        instants = [(observation, info["energy"], info["sensor_time"], env.unwrapped.state)]
        steps, ended = [], False
        while not ended:
            action = actions(rng) if actions else _random_action(env.action_space, rng)
            observation, reward, terminated, truncated, info = env.step(action)
            instants.append((observation, info["energy"], info["sensor_time"], env.unwrapped.state))
            steps.append((reward, info))
            ended = terminated or truncated
        played.append((instants, steps))
    return played


def _random_action(space, rng):
    if isinstance(space, gym.spaces.Discrete):
        return int(rng.integers(space.n))
    return rng.uniform(space.low, space.high).astype(np.float32)


@pytest.fixture(scope="session")
def play():
    return _play


@pytest.fixture
def context():
    return EpisodeContext(run_id="run", cell="cell", policy_id="random")


@pytest.fixture(scope="session")
def two_environments(tmp_path_factory):
    """A run's directory with three pendulum and three cart-pole records."""
    run = tmp_path_factory.mktemp("run")
    for env_id, cell in (("IntegPendulum-v0", "rk4 at 0.05 s"), ("IntegCartPole-v0", "balance")):
        context = EpisodeContext("run", cell, policy_id="random")
        env = gym.make(env_id, integrator="rk4", dt=0.05, control_period=0.05)
        env = RecordEvidence(env, run / "evidence", context)
        _play(env, range(3))
        env.close()
    return run


@pytest.fixture
def store(tmp_path, context):
    """A store with three short pendulum records in one batch."""
    env = RecordEvidence(gym.make("IntegPendulum-v0", duration=0.5), tmp_path, context)
    _play(env, range(3))
    env.commit("batch")
    env.close()
    return EvidenceStore(tmp_path)
