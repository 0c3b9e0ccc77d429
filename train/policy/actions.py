"""How the outputs of a policy's network become actions."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from .arrays import FloatArray, frozen


def spread(bound: ArrayLike, size: int) -> FloatArray:
    """A bound as float32 of shape (size,), from one number for all actions or one for each."""
    flat: FloatArray = np.asarray(bound, dtype=np.float32).ravel()
    return np.repeat(flat, size) if flat.size == 1 else flat


@dataclass(frozen=True, eq=False)
class BoxActions:
    """Network outputs as the actions of a one-dimensional `Box`.

    Attributes:
        low: float32, shape (action_dim,), lower bounds in the action's units, finite.
        high: float32, shape (action_dim,), upper bounds, finite.
        squash: False clips the outputs to the bounds; True passes them through tanh and stretches
            (−1, 1) to the bounds, as SB3 does with `squash_output=True`.
        limit: size that outputs are limited to before tanh, as SAC's with gSDE are.

    Raises:
        ValueError: on shapes that differ, bounds that are not finite, or `low` above `high`; or
            for a limit that is not above 0, or without tanh.
    """

    low: FloatArray
    high: FloatArray
    squash: bool = False
    limit: float = math.inf

    def __post_init__(self) -> None:
        """Copy the bounds and check them."""
        object.__setattr__(self, "low", frozen(self.low, np.float32))
        object.__setattr__(self, "high", frozen(self.high, np.float32))
        if self.low.ndim != 1 or self.low.shape != self.high.shape:
            raise ValueError(
                "the bounds 'low' and 'high' must be one-dimensional and of one shape, got "
                f"{self.low.shape} and {self.high.shape}"
            )
        if not self.limit > 0 or (self.limit < math.inf and not self.squash):
            raise ValueError(
                f"a limit of outputs must be above 0 and comes before tanh, got {self.limit} with "
                f"squash={self.squash}"
            )
        finite = np.isfinite(self.low) & np.isfinite(self.high)
        if not (finite & (self.low <= self.high)).all():
            raise ValueError(
                f"the action bounds must be finite and 'low' not above 'high', got {self}; "
                "give the bounds of the environment's action space"
            )

    @property
    def size(self) -> int:
        """Number of network outputs this needs."""
        return len(self.low)

    @property
    def space(self) -> spaces.Box:
        """The action space whose members are produced."""
        return spaces.Box(self.low, self.high, dtype=np.float32)

    def decode(self, outputs: FloatArray) -> FloatArray:
        """Actions, float32 of shape (n, action_dim), for network outputs of the same shape."""
        if not self.squash:
            return np.clip(outputs, self.low, self.high)
        if self.limit < math.inf:
            outputs = np.clip(outputs, -self.limit, self.limit)
        return self.low + (0.5 * (np.tanh(outputs) + 1.0) * (self.high - self.low))

    def __str__(self) -> str:
        """Kind and bounds, in one line."""
        return f"Box({self.low.tolist()}, {self.high.tolist()})"


@dataclass(frozen=True)
class DiscreteActions:
    """Network outputs as the choice among `Discrete(n)`.

    Attributes:
        n: number of actions, at least 1.

    Raises:
        ValueError: if `n` is below 1.
    """

    n: int

    def __post_init__(self) -> None:
        """Check the number of actions."""
        if self.n < 1:
            raise ValueError(f"a Discrete action space needs at least one action, got {self.n}")

    @property
    def size(self) -> int:
        """Number of network outputs this needs."""
        return self.n

    @property
    def space(self) -> spaces.Discrete:
        """The action space whose members are produced."""
        return spaces.Discrete(self.n)

    def decode(self, outputs: FloatArray) -> NDArray[np.int64]:
        """The first largest output of each row: int64, shape (n,), from shape (n, actions).

        Raises:
            ValueError: if an output is NaN, because no choice can be made.
        """
        if np.isnan(outputs).any():
            raise ValueError(
                "the policy network gives NaN, so no discrete action can be chosen; "
                "give it finite observations of ordinary size"
            )
        choice: NDArray[np.int64] = outputs.argmax(axis=1).astype(np.int64)
        return choice

    def __str__(self) -> str:
        """Kind and size."""
        return f"Discrete({self.n})"
