"""Means and medians of any scalar but success, with intervals."""

from __future__ import annotations

import math

import numpy as np

from integ_gym.support.packages.extras import load

from .interval import Interval, RatesLike, check_level, mean_of


def mean_interval(values: RatesLike, level: float = 0.95) -> Interval | None:
    """Mean over training seeds with Student's t interval, for any scalar but success.

    Meant for quantities such as time to success or energy residual. Seeds without a finite
    value (a policy that never succeeded has no time to success) are left out, so the result
    speaks only for seeds that have one: report how many those were. Equal seeds give an
    interval of no length.

    Parameters
    ----------
    values
        Shape (seeds,), one value per seed in any unit; NaN and infinities are left out.
    level
        Nominal coverage, in (0, 1).

    Returns
    -------
    The interval, or None with fewer than two finite values.

    Raises
    ------
    ValueError
        If ``values`` is not one-dimensional, or ``level`` is outside (0, 1).
    """
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1:
        raise ValueError(f"expected values of shape (seeds,), got {array.shape}")
    check_level(level)
    finite = array[np.isfinite(array)]
    if finite.size < 2:
        return None
    mean = mean_of(finite)
    spread = math.sqrt(math.fsum((finite - mean) ** 2) / (finite.size - 1) / finite.size)
    quantile = load("scipy.special", "report").stdtrit(finite.size - 1, 0.5 * (1.0 + level))
    half = float(quantile) * spread
    return Interval(mean, mean - half, mean + half, level)


def median_interval(values: RatesLike, level: float = 0.95) -> Interval | None:
    """Median over training seeds between two order statistics, whatever the distribution.

    Infinity stands for "not within the time there was": such seeds count as larger than all
    others, and an end or the median itself is infinite where too many are. The order statistics
    X(k) and X(n + 1 − k) with the largest k that covers the median often enough are taken; with
    fewer than 6 seeds even the extremes do not reach 95 %, and the level says what they reach.

    Parameters
    ----------
    values
        Shape (seeds,), one value per seed in any unit; infinities are allowed, NaN is not.
    level
        Least nominal coverage where the seeds allow it, in (0, 1).

    Returns
    -------
    Interval with the level that holds exactly for a continuous distribution, or None with
    fewer than two values.

    Raises
    ------
    ValueError
        If ``values`` is not one-dimensional or has a NaN, or ``level`` is outside (0, 1).
    """
    array = np.sort(np.asarray(values, dtype=np.float64))
    if array.ndim != 1 or np.isnan(array).any():
        raise ValueError(f"expected values of shape (seeds,) without NaN, got {values!r}")
    check_level(level)
    count = array.size
    if count < 2:
        return None
    tails = np.cumsum([math.comb(count, k) for k in range(count // 2)]) / 2.0**count
    covers = 1.0 - 2.0 * tails
    place = max(0, int(np.count_nonzero(covers >= level)) - 1)
    low, high = array[place], array[count - 1 - place]
    middle = array[(count - 1) // 2 : count // 2 + 1]
    return Interval(float(middle.mean()), float(low), float(high), float(covers[place]))
