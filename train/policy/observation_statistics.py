"""Scaling of observations before a policy's network."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arrays import FloatArray, frozen


@dataclass(frozen=True, eq=False)
class ObservationStatistics:
    """Observation scaling as SB3's `VecNormalize` applies it at evaluation.

    normalized = clip((observation − mean) / sqrt(var + epsilon), −clip_obs, clip_obs)

    Attributes:
        mean: float64, shape (obs_dim,), in the observation's units.
        var: float64, shape (obs_dim,), those units squared, not negative.
        epsilon: added to `var`, > 0.
        clip_obs: bound on the normalized value, > 0, no unit.

    Raises:
        ValueError: on shapes that differ, on values that are not finite or have the wrong sign.
    """

    mean: NDArray[np.float64]
    var: NDArray[np.float64]
    epsilon: float
    clip_obs: float

    def __post_init__(self) -> None:
        """Copy the arrays and check everything."""
        object.__setattr__(self, "mean", frozen(self.mean, np.float64))
        object.__setattr__(self, "var", frozen(self.var, np.float64))
        if self.mean.ndim != 1 or self.mean.shape != self.var.shape:
            raise ValueError(
                "'mean' and 'var' must be two lists of numbers of one length, got shapes "
                f"{self.mean.shape} and {self.var.shape}"
            )
        if not (np.isfinite(self.mean).all() and np.isfinite(self.var).all()):
            raise ValueError("'mean' and 'var' must hold finite numbers only")
        if (self.var < 0).any():
            raise ValueError(f"'var' must hold no negative number, got {self.var.min()}")
        for name, value in (("epsilon", self.epsilon), ("clip_obs", self.clip_obs)):
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"'{name}' must be a finite number above 0, got {value}")

    def normalize(self, observations: NDArray[Any]) -> FloatArray:
        """Normalized observations.

        Args:
            observations: shape (n, obs_dim), in the environment's units.

        Returns:
            float32, shape (n, obs_dim), no unit.
        """
        scaled = (observations - self.mean) / np.sqrt(self.var + self.epsilon)
        return np.clip(scaled, -self.clip_obs, self.clip_obs).astype(np.float32)
