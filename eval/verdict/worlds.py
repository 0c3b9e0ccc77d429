"""Worlds in which verdicts are tried: how training seeds may differ in what they learn."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeAlias

import numpy as np

from ..statistics.interval import Floats

Draw: TypeAlias = Callable[[np.random.Generator, float, int], Floats]

_CONCENTRATION: Final = 10.0


def all_or_nothing(rng: np.random.Generator, mean: float, seeds: int) -> Floats:
    """True rates of seeds that succeed from every start or from none."""
    return (rng.random(seeds) < mean).astype(np.float64)


def smooth(rng: np.random.Generator, mean: float, seeds: int) -> Floats:
    """True rates from a Beta law; its standard deviation at a mean of 0.9 is 0.09."""
    if mean in (0.0, 1.0):
        return np.full(seeds, mean)
    return rng.beta(_CONCENTRATION * mean, _CONCENTRATION * (1.0 - mean), seeds)


def mixed(rng: np.random.Generator, mean: float, seeds: int) -> Floats:
    """Half of what is missing to 1 is lost by seeds that fail altogether, half smoothly."""
    lost = 0.5 * (1.0 - mean)
    return np.where(rng.random(seeds) < lost, 0.0, smooth(rng, mean / (1.0 - lost), seeds))


WORLDS: Final[dict[str, Draw]] = {
    "all or nothing": all_or_nothing,
    "smooth": smooth,
    "mixed": mixed,
}


def measured(rng: np.random.Generator, draw: Draw, mean: float, seeds: int, starts: int) -> Floats:
    """Success rates that seeds of one world show, each from starts of its own, shape (seeds,)."""
    return np.asarray(rng.binomial(starts, draw(rng, mean, seeds)) / starts)
