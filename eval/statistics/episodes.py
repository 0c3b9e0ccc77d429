"""Paired episodes of one given policy: what its starts tell, and nothing of other policies."""

from __future__ import annotations

from typing import Final

import numpy as np

from integ_gym.support.packages.extras import load

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
    two-sided p-value of the test that flips the differences' signs (Fisher 1935), which is exact
    where they are symmetric about zero. Up to 13 episodes all signs are tried; with more, `FLIPS`
    draws give the p-value with a standard error of at most 0.01.

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
    return float(load("scipy.stats", "report").binomtest(more, count).pvalue) if count else 1.0


def _flip_test(differences: Floats) -> float:
    """Two-sided p-value where each difference's sign is as likely as the other."""
    if differences.size < 2:
        return 1.0
    found = load("scipy.stats", "report").permutation_test(
        (np.sort(differences),),
        lambda drawn, axis: np.abs(np.sum(drawn, axis=axis)),
        permutation_type="samples",
        alternative="greater",
        vectorized=True,
        n_resamples=draws_for(differences.size, FLIPS),
        batch=1000,
        rng=generator(Stream.PAIRED),
    )
    return float(found.pvalue)
