"""Rates of environments of different packages, measured alike and side by side."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Mapping
from typing import Any, TypeVar

import gymnasium as gym
import numpy as np

Name = TypeVar("Name", bound=Hashable)
Advance = Callable[[], int]
"""Does some steps and tells how many."""

TURN = 201
"""Steps of a turn, per lane: one of the pendulum's episodes and its reset."""

ACTIONS = 16
"""Different actions of all lanes, drawn before the clock starts."""

QUANTILE = 0.95
FEWEST = 5
"""Turns of each contender."""


def rates(contenders: Mapping[Name, Advance], seconds: float) -> dict[Name, float]:
    """Steps per second of contenders that take turns.

    A rate is that of a fast turn: what else runs on the machine slows some of them, and all
    contenders alike.

    Args:
        contenders: by name.
        seconds: time for each.
    """
    found = turns(contenders, seconds)
    return {name: float(np.quantile(values, QUANTILE)) for name, values in found.items()}


def turns(
    contenders: Mapping[Name, Advance],
    seconds: float,
    begin: Callable[[], None] = lambda: None,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[Name, list[float]]:
    """Steps per second of every turn of the contenders, which change places after each.

    Args:
        contenders: by name.
        seconds: time for each.
        begin: what is done before each round of turns, off the clock.
        clock: by which turns are timed, s.
    """
    found: dict[Name, list[float]] = {name: [] for name in contenders}
    begin()
    for advance in contenders.values():
        advance()
    end = time.perf_counter() + seconds * len(contenders)
    while len(next(iter(found.values()))) < FEWEST or time.perf_counter() < end:
        begin()
        for name, advance in contenders.items():
            start = clock()
            steps = advance()
            found[name].append(steps / (clock() - start))
    return found


def single(environment: gym.Env[Any, Any]) -> Advance:
    """Random actions to one environment, resets included."""
    environment.action_space.seed(0)
    actions = [environment.action_space.sample() for _ in range(TURN)]
    environment.reset(seed=0)

    def advance() -> int:
        for action in actions:
            _, _, terminated, truncated, _ = environment.step(action)
            if terminated or truncated:
                environment.reset()
        return len(actions)

    return advance


def vector(environment: Any, lanes: int) -> Advance:
    """Random actions to many environments, which reset by themselves."""
    environment.reset(seed=0)
    return _all_lanes(environment, environment.single_action_space, lanes)


def envpool(env_id: str, lanes: int, threads: int) -> Advance | None:
    """The same to EnvPool's; None where it is not installed."""
    try:
        from envpool import make
    except ModuleNotFoundError:
        return None
    environment = make(env_id, env_type="gymnasium", num_envs=lanes, num_threads=threads, seed=0)
    environment.reset()
    return _all_lanes(environment, environment.action_space, lanes)


def _all_lanes(environment: Any, space: gym.Space[Any], lanes: int) -> Advance:
    spaces = gym.vector.utils.batch_space(space, lanes)
    spaces.seed(0)
    actions = [spaces.sample() for _ in range(ACTIONS)]

    def advance() -> int:
        for number in range(TURN):
            environment.step(actions[number % ACTIONS])
        return TURN * lanes

    return advance
