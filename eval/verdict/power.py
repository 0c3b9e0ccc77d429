"""What a number of training seeds can show, before they are trained and after."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from .looks import FIRST_LOOK, Looks, Shares
from .loss import Rates, p_overfitting_exceeds, p_overfitting_within
from .rules import EQUIVALENCE_MARGIN, FAIL_MARGIN, MIN_SEEDS
from .worlds import WORLDS, Draw, measured

OVERFITTING: Final = (0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5)
"""True overfitting for which power is stated."""

HOME: Final = 0.99
"""True success at home, and of natives, for which it is."""

WANTED: Final = 0.8
"""Chance of a verdict from which on a number of seeds is said to decide."""

FARTHEST: Final = 8
"""How many times the seeds that there are may be said to be wanted."""

_GROWTH: Final = 1.15
_DRAWS: Final = 4000
_FINE: Final = 50_000
_MOST: Final = 400


@dataclass(frozen=True)
class Power:
    """Chances of both verdicts on one transfer, each the lowest and highest of three worlds.

    Attributes
    ----------
    overfitting
        The true one.
    transfers, fails
        Chance of the verdict, (lowest, highest), in [0, 1].
    """

    overfitting: float
    transfers: tuple[float, float]
    fails: tuple[float, float]


def verdict_chances(
    seeds: int,
    natives: int,
    starts: int,
    family: int,
    looks: Looks = FIRST_LOOK,
    *,
    repeats: int = 100,
) -> tuple[Power, ...]:
    """Chances of a verdict, simulated in the three worlds of `WORLDS`.

    Policies and natives succeed at home with 0.99, a hand-made controller always. Every verdict
    is taken at the level of its look, divided by the size of the family: Holm's procedure is never
    harder.

    Parameters
    ----------
    seeds, natives
        Training seeds of the policies that are judged and of those trained in the cell.
    starts
        Of every seed.
    family
        How many transfers are declared.
    looks
        Earlier looks, and those that were planned.
    repeats
        Simulated transfers for each chance.
    """
    rng, shares = np.random.default_rng(0), looks.shares(seeds)

    def chances(draw: Draw, lost: float) -> tuple[float, float]:
        told = [
            _verdicts(_simulated(rng, draw, lost, seeds, natives, starts), shares, family)
            for _ in range(repeats)
        ]
        first, second = np.mean(told, axis=0)
        return float(first), float(second)

    found = []
    for lost in OVERFITTING:
        transfers, fails = zip(*(chances(draw, lost) for draw in WORLDS.values()), strict=True)
        found.append(Power(lost, (min(transfers), max(transfers)), (min(fails), max(fails))))
    return tuple(found)


def fewest_seeds(family: int, looks: Looks = FIRST_LOOK) -> int:
    """With how many seeds, all of which always succeed, every member of a family `transfers`.

    At the look that comes next, or at any planned one.
    """

    def shown(seeds: int) -> bool:
        rates = Rates(*(np.ones(seeds),) * 3)
        own = Looks((), (seeds,) * len(looks.planned)) if looks.planned else looks
        _, level = own.shares(seeds).levels
        return p_overfitting_within(rates, EQUIVALENCE_MARGIN, draws=_FINE) < level / family

    return _first(MIN_SEEDS, _MOST, shown)


def seeds_wanted(
    rates: Rates, family: int, looks: Looks = FIRST_LOOK, *, repeats: int = 60
) -> int | None:
    """How many seeds would decide a transfer, if more were as those that there are.

    Parameters
    ----------
    rates
        What was measured.
    family
        How many transfers are tested.
    looks
        Earlier looks, this one included, and those that were planned: of these, one must come.
    repeats
        Resamples of the seeds for each number tried.

    Returns
    -------
    The smallest number tried with which four in five resamples get a verdict; None if eight times
    as many seeds do not suffice: overfitting then lies between the margins, or near one; or if no
    planned look does.
    """
    rng = np.random.default_rng(0)
    for seeds in _more_seeds(len(rates.home), looks.planned):
        shares = looks.shares(seeds)
        told = [_verdicts(_resampled(rng, rates, seeds), shares, family) for _ in range(repeats)]
        if np.mean([any(one) for one in told]) >= WANTED:
            return seeds
    return None


def _more_seeds(now: int, planned: Sequence[int]) -> Iterator[int]:
    """Numbers of seeds to try: those of planned looks, or ever more."""
    if planned:
        yield from (seeds for seeds in planned if seeds > now)
        return
    seeds = now
    while seeds < FARTHEST * now:
        seeds = math.ceil(seeds * _GROWTH)
        yield seeds


def _first(low: int, high: int, holds: Callable[[int], bool]) -> int:
    """The smallest number in [low, high] for which it holds, as for all above it."""
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if holds(middle) else (middle + 1, high)
    return low


def _verdicts(rates: Rates, shares: Shares, family: int) -> tuple[bool, bool]:
    """Whether a transfer is said to hold, and whether to fail."""
    above, within = (level / family for level in shares.levels)
    if above > 0.0 and p_overfitting_exceeds(rates, FAIL_MARGIN, draws=_DRAWS) < above:
        return False, True
    if within == 0.0:
        return False, False
    return p_overfitting_within(rates, EQUIVALENCE_MARGIN, draws=_DRAWS) < within, False


def _simulated(
    rng: np.random.Generator, draw: Draw, lost: float, seeds: int, natives: int, starts: int
) -> Rates:
    home = measured(rng, draw, HOME, seeds, starts)
    there = measured(rng, draw, HOME - lost, seeds, starts)
    native = measured(rng, draw, HOME, natives, starts) if natives else None
    return Rates(home, there, there, native, np.ones(100))


def _resampled(rng: np.random.Generator, rates: Rates, seeds: int) -> Rates:
    """So many seeds drawn from those that there are, natives likewise."""
    row = rates.row[:, rng.integers(rates.row.shape[1], size=seeds)]
    native = None if rates.native is None else np.asarray(rates.native)
    if native is not None:
        native = native[rng.integers(native.size, size=native.size)]
    return Rates(row[0], row[1], row[2], native, rates.handmade)
