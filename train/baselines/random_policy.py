"""Actions at random."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ..policy.arrays import ActionArray
from .interface import Baseline


class RandomPolicy(Baseline):
    """Uniform over the action space, as a fixed random function of the observation.

    The action is a hash of the seed and of the observation's float32 bits, made uniform. So the
    policy has no memory: an episode that is played again, alone or in another batch, is the same
    episode, as with every other policy. Observations that differ in one bit give independent
    actions.

    Args:
        space: of actions: `Discrete`, or a `Box` of action_dim numbers with finite bounds.
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
        """Seed and action space, its bounds as one number where one says them."""
        common = {"seed": self.seed, "actions": self.count}
        if self.count is not None:
            return common
        low, high = self.low.tolist(), self.high.tolist()
        limits = {"limit": high[0]} if low == [-high[0]] else {"low": low, "high": high}
        return {**common, **limits}

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


def bounds_of(space: spaces.Space[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lower and upper bounds of a `Box`, each the shortest decimal number that its float32 means.

    Raises:
        ValueError: for a space that is no `Box` of numbers with finite bounds.
    """
    if not (isinstance(space, spaces.Box) and space.shape and space.is_bounded()):
        raise ValueError(
            f"random and zero are for a Discrete set or a bounded Box of actions, got {space}"
        )
    low, high = (
        np.array([float(str(x)) for x in side]) for side in (space.low.ravel(), space.high.ravel())
    )
    return low, high


def hashed_uniform(observations: NDArray[Any], seed: int, count: int) -> NDArray[np.float64]:
    """Numbers in [0, 1) that a hash makes of the seed and of the observations' float32 bits.

    Args:
        observations: shape (n, obs_dim).
        seed: chooses the function.
        count: numbers per observation.

    Returns:
        Shape (n, count).
    """
    values = np.asarray(observations, dtype=np.float32) + np.float32(0.0)  # -0.0 is 0.0
    bits = np.full(len(values), seed, dtype=np.uint64)
    for column in values.view(np.uint32).T:
        bits = _scrambled(bits ^ column.astype(np.uint64))
    drawn = [bits]
    for _ in range(count - 1):
        drawn.append(_scrambled(drawn[-1]))
    return (np.stack(drawn, axis=1) >> np.uint64(11)).astype(np.float64) * 2.0**-53


def _scrambled(bits: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """One step of SplitMix64: Steele, Lea and Flood (2014), *Fast splittable pseudorandom number
    generators*."""
    bits = bits + np.uint64(0x9E3779B97F4A7C15)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))
