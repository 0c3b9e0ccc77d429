"""One number per training seed, checked, and an interval about it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from integ_gym.support.terminal import percent

Floats: TypeAlias = npt.NDArray[np.float64]
"""A float64 array."""

RatesLike: TypeAlias = Sequence[float] | Floats
"""One number per training seed."""


@dataclass(frozen=True)
class Interval:
    """An estimate with a two-sided, equal-tailed interval; units are those of the data.

    Attributes
    ----------
    estimate
        Point estimate from the seeds alone (no prior in it); always inside the interval.
    low, high
        Ends of the interval.
    level
        Nominal coverage, in (0, 1).
    """

    estimate: float
    low: float
    high: float
    level: float

    def __str__(self) -> str:
        ends = f"{self.low:z.2f} to {self.high:z.2f}"
        return f"{self.estimate:z.2f} ({percent(self.level)} interval {ends})"


def equal_tailed(estimate: float, draws: Floats, level: float) -> Interval:
    """Equal-tailed interval of the draws, stretched where needed to hold the estimate."""
    check_level(level)
    tail = 0.5 * (1.0 - level)
    low, high = np.quantile(draws, [tail, 1.0 - tail])
    return Interval(estimate, min(float(low), estimate), max(float(high), estimate), level)


def mean_of(values: Floats) -> float:
    """Mean, correctly rounded before the division, so that order does not matter."""
    return math.fsum(values) / values.size


def one_dimensional(rates: RatesLike, name: str) -> Floats:
    """Success rates of shape (seeds,), checked."""
    array = checked_rates(rates, name)
    if array.ndim != 1:
        raise ValueError(f"expected {name} of shape (seeds,), got {array.shape}")
    return array


def checked_rates(rates: RatesLike, name: str) -> Floats:
    """Success rates of shape (..., seeds), checked to be in [0, 1]."""
    array = np.asarray(rates, dtype=np.float64)
    if array.ndim < 1 or array.size == 0:
        raise ValueError(f"expected {name} with at least one training seed, got {array.shape}")
    wrong = array[~((array >= 0.0) & (array <= 1.0))]
    if wrong.size:
        raise ValueError(f"expected {name} in [0, 1], got {wrong.flat[0]}")
    return array


def require_finite(array: Floats, name: str) -> None:
    """Refuse an empty array and values that are not finite."""
    if array.size == 0:
        raise ValueError(f"expected at least one value in {name}, got none")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"expected finite {name}, got {array[~np.isfinite(array)][0]}")


def check_level(level: float) -> None:
    """Refuse a nominal coverage outside (0, 1)."""
    if not 0.0 < level < 1.0:
        raise ValueError(f"expected a level in (0, 1), got {level!r}")
