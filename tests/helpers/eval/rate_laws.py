"""Laws of success rates over seeds that statistics are tried on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy import stats

Array = npt.NDArray[np.float64]
Law = Callable[[np.random.Generator, tuple[int, int]], Array]


def smooth(mean: float, sd: float) -> Law:
    """Beta law of a given mean and standard deviation."""
    size = mean * (1.0 - mean) / sd**2 - 1.0
    return lambda rng, shape: rng.beta(mean * size, (1.0 - mean) * size, shape)


def bimodal(mean: float) -> Law:
    """Seeds that nearly always fail (mean 1/31) or nearly always succeed (mean 30/31)."""
    share = (mean * 31.0 - 1.0) / 29.0

    def draw(rng: np.random.Generator, shape: tuple[int, int]) -> Array:
        good = rng.random(shape) < share
        return np.where(good, rng.beta(30.0, 1.0, shape), rng.beta(1.0, 30.0, shape))

    return draw


def lattice(seeds: int) -> Array:
    """All-or-nothing rates: row k has k successes. Shape (seeds + 1, seeds)."""
    return np.tri(seeds + 1, seeds, -1)


def chance(seeds: int, rate: float) -> Array:
    """Probability of each row of `lattice` when a seed succeeds with probability ``rate``."""
    return np.asarray(stats.binom.pmf(np.arange(seeds + 1), seeds, rate))
