"""No action at all."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ..policy.arrays import FloatArray
from .interface import Baseline
from .random_policy import bounds_of


class ZeroPolicy(Baseline):
    """No control at all: zero, or where the bounds leave it out, the bound that is nearest to it.

    A `Discrete` action set has no zero (the cart-pole's two actions push left and right), so there
    the action is NaN, on which the environment's fallback acts. It gives 0 N from the first step:
    with ``fallback="zero"`` because it says so, and with ``fallback="hold"`` because before any
    command there is nothing but 0 N to hold. Every step is counted as fallback.

    Args:
        space: of actions: `Discrete`, or a `Box` of action_dim numbers with finite bounds.

    Raises:
        ValueError: for another space.
    """

    policy_id = "zero"

    def __init__(self, space: spaces.Space[Any]) -> None:
        self.discrete = isinstance(space, spaces.Discrete)
        self.action = np.float32(np.nan)
        if not self.discrete:
            low, high = bounds_of(space)
            self.action = np.clip(0.0, low, high).astype(np.float32)

    def parameters(self) -> dict[str, Any]:
        """Kind of the action space, and the action where it is not zero."""
        other = {} if self.discrete or not self.action.any() else {"action": self.action.tolist()}
        return {"discrete": self.discrete, **other}

    def act(self, observations: NDArray[Any]) -> FloatArray:
        """Zeros of shape (n, action_dim), or NaN of shape (n,) for a `Discrete` space; float32."""
        return np.full((len(observations), *self.action.shape), self.action)
