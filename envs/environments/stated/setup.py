"""What is known of an environment whose maker states its discretization."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from integ_gym.support.packages.versions import running_version

from ...episode.discretization import Discretization
from ...episode.settings import Settings
from ...episode.timing import Timing
from ..foreign import ForeignPlant, ForeignSetup, ForeignTask, time_limit

ASSUMED_RATE = "rate, which nobody said"
"""What a record says where rewards were taken for rates by default."""


@dataclass(frozen=True)
class StatedEngine:
    """What advances it, by the name of its package."""

    package: str
    width: int | None = None
    reports: bool = False
    rewards: str | None = None
    """What a step's rewards are taken for, where a decision has several; None: not known here."""

    @property
    def version(self) -> str:
        """The package's version."""
        return running_version(self.package)

    def solver(self) -> dict[str, Any]:
        """Nothing is known of it."""
        return {}

    def describe(self) -> dict[str, Any]:
        """That losses are not accounted for, and what rewards are taken for."""
        taken = {} if self.rewards is None else {"rewards": self.rewards}
        return {"losses_accounted": False, **taken}


def _rewards(env: gym.Env[Any, Any]) -> str | None:
    if not env.has_wrapper_attr("rewards_assumed"):
        return None
    assumed = env.get_wrapper_attr("rewards_assumed")
    return ASSUMED_RATE if assumed else str(env.get_wrapper_attr("rewards"))


def stated_setup(
    env: gym.Env[Any, Any],
    applied: Discretization,
    goal: str,
    arguments: Mapping[str, Any],
) -> ForeignSetup:
    """What is known of an environment.

    Args:
        env: with a time limit.
        applied: its discretization.
        goal: success in words.
        arguments: that it was made with.

    Raises:
        TypeError: for spaces of another kind than `Box`, and `Discrete` actions.
        ValueError: without a time limit.
    """
    action, observation = env.action_space, env.observation_space
    if not isinstance(observation, spaces.Box) or not isinstance(
        action, (spaces.Box, spaces.Discrete)
    ):
        raise TypeError(
            f"a testbed's environment must have a Box of observations and a Box or Discrete of "
            f"actions, got {observation} and {action}"
        )
    limit = time_limit(env)
    if limit is None:
        raise ValueError(
            f"{type(env.unwrapped).__name__} has no time limit, so its episodes may never end; "
            "wrap it in gymnasium.wrappers.TimeLimit"
        )
    period = applied.control_period
    discrete = int(action.n) if isinstance(action, spaces.Discrete) else None
    count = 1 if discrete is not None else int(np.prod(action.shape or (1,)))
    size = int(np.prod(observation.shape or (1,)))
    return ForeignSetup(
        settings=Settings(
            integrator=applied.integrator, dt=applied.dt, control_period=period,
            engine=applied.engine, duration=limit * period, start="the environment's own",
        ),
        timing=Timing.of(applied.dt, period, 0.0, None, limit * period),
        plant=ForeignPlant(
            getattr(env.unwrapped, "title", type(env.unwrapped).__name__),
            tuple((f"action{k}", "") for k in range(count))
        ),
        task=ForeignTask(goal, tuple(f"obs{k}" for k in range(size)), ("",) * size, discrete),
        engine=StatedEngine(applied.engine, rewards=_rewards(env)),
        action_space=action,
        environment=tuple(sorted(arguments.items())),
    )  # fmt: skip
