"""Actions at random."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from integ_gym.envs.settings import Setup
from integ_gym.train.baselines.hashed_uniform import hashed_uniform
from integ_gym.train.baselines.interface import Baseline
from integ_gym.train.policy.arrays import ActionArray


class RandomPolicy(Baseline):
    """Uniform over the action space, as a fixed random function of the observation.

    The action is a hash of the seed and of the observation's float32 bits, made uniform. So the
    policy has no memory: an episode that is played again, alone or in another batch, is the same
    episode, as with every other policy. Observations that differ in one bit give independent
    actions.

    Args:
        setup: of the environment.
        seed: chooses the function.
    """

    policy_id = "random"

    def __init__(self, setup: Setup, seed: int = 0) -> None:
        self.seed = seed
        self.count = setup.task.discrete
        self.limit = float(setup.task.control_limit)

    def parameters(self) -> dict[str, Any]:
        """Seed and action space."""
        return {"seed": self.seed, "actions": self.count, "limit": self.limit}

    def act(self, observations: NDArray[Any]) -> ActionArray:
        """Random actions.

        Args:
            observations: shape (n, obs_dim).

        Returns:
            float32 of shape (n, 1), N or N m, or int64 of shape (n,) for a `Discrete` space.
        """
        uniform = hashed_uniform(observations, self.seed, 1)[:, 0]
        if self.count is not None:
            return (uniform * self.count).astype(np.int64)
        return ((2.0 * uniform - 1.0) * self.limit).astype(np.float32)[:, None]
