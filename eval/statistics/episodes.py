"""Paired episodes of one given policy: what its starts tell, and nothing of other policies."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from .interval import Floats, Interval, RatesLike, equal_tailed, mean_of, require_finite
from .posterior import DRAWS, paired_posterior
from .scalars import mean_interval
from .streams import Stream, generator

FLIPS: Final = 10_000
"""Draws of signs in a test of paired returns."""

_MOST_NUMBERS: Final = 10_000_000
"""Largest array of draws, in numbers."""


def draws_for(units: int, most: int = DRAWS) -> int:
    """Draws that fit the memory for so many units of replication: fewer where these are many."""
    return max(1000, min(most, _MOST_NUMBERS // max(1, units)))


def paired_success(
    first: RatesLike, second: RatesLike, level: float = 0.95
) -> tuple[Interval, float]:
    """Success of one policy in two places from the same starts: first − second.

    The unit of replication is the episode, so the interval and the test are about this policy and
    starts like these. The test is the exact sign test of the episodes that end differently, which
    for successes and failures is McNemar's (1947).

    Parameters
    ----------
    first, second
        Shape (episodes,), in [0, 1]: entry k of both has the same start.
    level
        Nominal coverage of the interval, in (0, 1).

    Returns
    -------
    The difference with the interval of `paired_posterior`, and the two-sided p-value.

    Raises
    ------
    ValueError
        As `paired_posterior`.
    """
    one, other = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    posterior = paired_posterior(one, other, draws=draws_for(one.size))
    estimate = mean_of(one) - mean_of(other)
    more, less = int(np.count_nonzero(one > other)), int(np.count_nonzero(one < other))
    return equal_tailed(estimate, posterior, level), _sign_test(more, less)


def paired_return(
    first: RatesLike, second: RatesLike, level: float = 0.95
) -> tuple[Interval | None, float]:
    """Returns of one policy in two places from the same starts: mean of first − second.

    Parameters
    ----------
    first, second
        Shape (episodes,), in any unit: entry k of both has the same start.
    level
        Nominal coverage of the interval, in (0, 1).

    Returns
    -------
    The mean difference with Student's t interval, None of fewer than two episodes; and the
    two-sided p-value of the test that flips the differences' signs at random (Fisher 1935), which
    is exact where they are symmetric about zero.

    Raises
    ------
    ValueError
        If the shapes differ, there is no episode, or a value is not finite.
    """
    one, other = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    if one.shape != other.shape or one.ndim != 1:
        raise ValueError(
            f"paired returns need one value per start on both sides, got shapes {one.shape} and "
            f"{other.shape}"
        )
    differences = one - other
    require_finite(differences, "returns")
    return mean_interval(differences, level), _flip_test(differences)


def _sign_test(more: int, less: int) -> float:
    """Two-sided p-value of the binomial test that either sign is as likely."""
    count = more + less
    tail = sum(math.comb(count, k) for k in range(min(more, less) + 1))
    return min(1.0, float(2 * tail / 2**count))


def _flip_test(differences: Floats) -> float:
    """Two-sided p-value under random signs; the signs as they are count as one draw."""
    sizes = np.sort(np.abs(differences))
    draws = draws_for(sizes.size, FLIPS)
    signs = generator(Stream.PAIRED).integers(0, 2, size=(draws, sizes.size), dtype=np.int8)
    drawn = np.abs((2.0 * signs - 1.0) @ sizes)
    found = abs(math.fsum(differences)) * (1.0 - 1e-12)
    return (int(np.count_nonzero(drawn >= found)) + 1) / (draws + 1)
