"""Recorded episodes of random actions."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import integ_gym  # noqa: F401
from integ_gym.evidence.labels import EpisodeContext
from integ_gym.evidence.recorder import RecordEvidence
from integ_gym.evidence.store import EvidenceStore

CONTEXT = EpisodeContext("run", "cell", policy_id="random")
PENDULUM = "IntegPendulum-v0"


def play(env: Any, seeds: Iterable[int | None]) -> list[tuple[list[Any], list[Any]]]:
    """Play one episode per seed; what each instant and step gave, as the policy saw it."""
    played = []
    for seed in seeds:
        rng = np.random.default_rng([7, seed or 0])
        observation, info = env.reset(seed=seed)
        instants = [(observation, info["energy"], info["sensor_time"], env.unwrapped.state)]
        steps, ended = [], False
        while not ended:
            action = random_action(env.action_space, rng)
            observation, reward, terminated, truncated, info = env.step(action)
            instants.append((observation, info["energy"], info["sensor_time"], env.unwrapped.state))
            steps.append((reward, info))
            ended = terminated or truncated
        played.append((instants, steps))
    return played


def random_action(space: gym.Space[Any], rng: np.random.Generator) -> Any:
    """Any action of a space."""
    if isinstance(space, gym.spaces.Discrete):
        return int(rng.integers(space.n))
    return rng.uniform(space.low, space.high).astype(np.float32)


def run_out(env: Any, action: Any = None) -> None:
    """Play an episode that was begun to its end, with one action or sampled ones."""
    ended = False
    while not ended:
        given = env.action_space.sample() if action is None else action
        *_, terminated, truncated, _ = env.step(given)
        ended = terminated or truncated


def made(
    directory: Path, context: EpisodeContext = CONTEXT, env_id: str = PENDULUM, **arguments: Any
) -> RecordEvidence:
    """A recorded environment of short episodes."""
    env = gym.make(env_id, **{"duration": 0.5, **arguments})
    return RecordEvidence(env, directory, context)


def recorded(directory: Path, seeds: Iterable[int | None] = range(1), *of: Any, **arguments: Any):
    """The store of episodes of :func:`made`, one per seed."""
    env = made(directory, *of, **arguments)
    play(env, seeds)
    env.close()
    return EvidenceStore(directory)
