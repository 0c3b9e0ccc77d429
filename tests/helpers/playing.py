"""Policies played on one batch of episodes."""

from __future__ import annotations

from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from integ_gym.envs.transition import control_columns
from integ_gym.train.baselines import make_baseline

PENDULUM, CART_POLE = "IntegPendulum-v0", "IntegCartPole-v0"
SWING_UP, ELASTIC = "IntegCartPoleSwingUp-v0", "IntegElasticPendulum-v0"
QUADROTOR, REACHER = "IntegQuadrotor-v0", "IntegReacher-v0"
HOPPER = "IntegHopper-v0"
ACROBOT, ACROBOT_UP = "IntegAcrobot-v0", "IntegAcrobotSwingUp-v0"
TIGHT = {"integrator": "reference", "dt": 0.05, "start": "hanging"}
EPISODES = 50


class Result(NamedTuple):
    """Of one batch of episodes."""

    success: float
    since: NDArray[np.float64]
    """When the final stay at the goal began, s, of the episodes that succeeded."""
    returns: NDArray[np.float64]
    controls: NDArray[np.float64]
    """Applied, of several the first, shape (steps, episodes)."""


def setup_of(env_id: str, **arguments: Any) -> Any:
    return gym.make(env_id, **arguments).unwrapped.setup  # type: ignore[attr-defined]


def play(env_id: str, policy: Any, episodes: int = EPISODES, **arguments: Any) -> Result:
    """Evaluate a policy, or the baseline of a name, on a batch of episodes that start anew."""
    envs = gym.make_vec(
        env_id, num_envs=episodes, vectorization_mode="vector_entry_point", **arguments
    )
    setup = envs.unwrapped.setup  # type: ignore[attr-defined]
    policy = make_baseline(policy, setup) if isinstance(policy, str) else policy
    observations, _ = envs.reset(seed=100)
    running = np.ones(episodes, dtype=bool)
    success, since = np.zeros(episodes, dtype=bool), np.zeros(episodes)
    returns, controls = np.zeros(episodes), []
    _, applied = next(control_columns(setup.plant))
    for _ in range(setup.timing.horizon):
        observations, rewards, terminated, truncated, info = envs.step(policy.act(observations))
        returns += np.where(running, rewards, 0.0)
        controls.append(info[applied])
        ended = running & (terminated | truncated)
        success[ended], since[ended] = info["success"][ended], info["goal_since"][ended]
        running &= ~ended
        if not running.any():
            break
    return Result(float(success.mean()), since[success], returns, np.array(controls))
