"""No action at all."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from integ_gym.envs.settings import Setup
from integ_gym.train.baselines.interface import Baseline
from integ_gym.train.policy.arrays import FloatArray


class ZeroPolicy(Baseline):
    """No control at all: 0 N m, or 0 N.

    A `Discrete` action set has no zero (the cart-pole's two actions push left and right), so there
    the action is NaN, on which the environment's fallback acts. It gives 0 N from the first step:
    with ``fallback="zero"`` because it says so, and with ``fallback="hold"`` because before any
    command there is nothing but 0 N to hold. Every step is counted as fallback.

    Args:
        setup: of the environment.
    """

    policy_id = "zero"

    def __init__(self, setup: Setup) -> None:
        self.discrete = setup.task.discrete is not None

    def parameters(self) -> dict[str, Any]:
        """Kind of the action space."""
        return {"discrete": self.discrete}

    def act(self, observations: NDArray[Any]) -> FloatArray:
        """Zeros of shape (n, 1), or NaN of shape (n,) for a `Discrete` space; float32."""
        n = len(observations)
        if self.discrete:
            return np.full(n, np.nan, dtype=np.float32)
        return np.zeros((n, 1), dtype=np.float32)
