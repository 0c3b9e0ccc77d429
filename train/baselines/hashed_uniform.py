"""Random numbers that are a function of an observation and a seed."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


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
