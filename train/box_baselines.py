"""Baselines for any task with a `Box` of actions, about which nothing else is known."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from integ_gym.train.baselines.hashed_uniform import hashed_uniform
from integ_gym.train.baselines.interface import Baseline
from integ_gym.train.policy.arrays import FloatArray
from integ_gym.train.policy.interface import Policy

BOX_BASELINES = ("random", "zero")
"""Names of the baselines that `box_baselines` makes."""


def box_baselines(space: spaces.Space[Any], *, seed: int = 0) -> list[Policy]:
    """One policy for each of `BOX_BASELINES`.

    Args:
        space: actions: a `Box` of shape (action_dim,) with finite bounds.
        seed: of `random`.

    Raises:
        TypeError: for another space.
    """
    if not isinstance(space, spaces.Box):
        raise TypeError(f"these baselines are for a Box of actions, got {space}")
    return [RandomInBox(space, seed), ZeroInBox(space)]


class _InBox(Baseline):
    """Actions within the bounds of a space."""

    def __init__(self, space: spaces.Box) -> None:
        self.low = np.asarray(space.low, dtype=np.float32)
        self.high = np.asarray(space.high, dtype=np.float32)

    def parameters(self) -> dict[str, Any]:
        """The bounds."""
        return {"low": self.low.tolist(), "high": self.high.tolist()}


class RandomInBox(_InBox):
    """Uniform within the bounds, as a fixed random function of the observation.

    See :class:`integ_gym.train.baselines.random_policy.RandomPolicy`.

    Args:
        space: actions.
        seed: chooses the function.
    """

    policy_id = "random"

    def __init__(self, space: spaces.Box, seed: int = 0) -> None:
        super().__init__(space)
        self.seed = seed

    def parameters(self) -> dict[str, Any]:
        """Seed and bounds."""
        return {"seed": self.seed, **super().parameters()}

    def act(self, observations: NDArray[Any]) -> FloatArray:
        """Actions, float32 of shape (n, action_dim), of observations of shape (n, obs_dim)."""
        uniform = hashed_uniform(observations, self.seed, len(self.low))
        return (self.low + uniform * (self.high - self.low)).astype(np.float32)


class ZeroInBox(_InBox):
    """Zero, or where the bounds leave it out, the bound that is nearest to it.

    Args:
        space: actions.
    """

    policy_id = "zero"

    def act(self, observations: NDArray[Any]) -> FloatArray:
        """Zeros, float32 of shape (n, action_dim), of observations of shape (n, obs_dim)."""
        zero = np.clip(np.zeros_like(self.low), self.low, self.high)
        return np.tile(zero, (len(observations), 1))
