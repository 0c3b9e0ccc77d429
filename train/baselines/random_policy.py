"""Actions at random."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ..policy import ActionArray
from .hashed_uniform import hashed_uniform
from .interface import Baseline


class RandomPolicy(Baseline):
    """Uniform over the action space, as a fixed random function of the observation.

    The action is a hash of the seed and of the observation's float32 bits, made uniform. So the
    policy has no memory: an episode that is played again, alone or in another batch, is the same
    episode, as with every other policy. Observations that differ in one bit give independent
    actions.

    Args:
        space: of actions: `Discrete`, or a `Box` of shape (action_dim,) with finite bounds.
        seed: chooses the function.

    Raises:
        ValueError: for another space.
    """

    policy_id = "random"

    def __init__(self, space: spaces.Space[Any], seed: int = 0) -> None:
        self.seed = seed
        self.count = int(space.n) if isinstance(space, spaces.Discrete) else None
        if self.count is None:
            self.low, self.high = bounds_of(space)

    def parameters(self) -> dict[str, Any]:
        """Seed and action space."""
        return {"seed": self.seed, "actions": self.count, **self._limits()}

    def act(self, observations: NDArray[Any]) -> ActionArray:
        """Random actions.

        Args:
            observations: shape (n, obs_dim).

        Returns:
            float32 of shape (n, action_dim), or int64 of shape (n,) for a `Discrete` space.
        """
        if self.count is not None:
            uniform = hashed_uniform(observations, self.seed, 1)[:, 0]
            return (uniform * self.count).astype(np.int64)
        uniform = hashed_uniform(observations, self.seed, len(self.low))
        middle, reach = 0.5 * (self.high + self.low), 0.5 * (self.high - self.low)
        return (middle + (2.0 * uniform - 1.0) * reach).astype(np.float32)

    def _limits(self) -> dict[str, Any]:
        """The bounds, as one number where one says them."""
        if self.count is not None:
            return {}
        low, high = self.low.tolist(), self.high.tolist()
        return {"limit": high[0]} if low == [-high[0]] else {"low": low, "high": high}


def bounds_of(space: spaces.Space[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lower and upper bounds of a `Box`, each the shortest decimal number that its float32 means.

    Raises:
        ValueError: for a space that is no `Box` of shape (action_dim,) with finite bounds.
    """
    if not (isinstance(space, spaces.Box) and len(space.shape) == 1 and space.is_bounded()):
        raise ValueError(
            f"random and zero are for a Discrete set or a bounded Box of actions, got {space}"
        )
    low, high = (np.array([float(str(x)) for x in side]) for side in (space.low, space.high))
    return low, high
