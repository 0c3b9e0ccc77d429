"""Intervals and tests over training seeds.

The unit of replication is the training seed: two episodes of one policy are not two
experiments. Every function here takes one number per seed (or one row per seed) and says how
far the seeds at hand speak for the seeds that were not run.

Success rates get their own method, because a handful of seeds that all succeed, or that either
succeed or fail outright, defeats the usual ones: a percentile bootstrap of three perfect seeds
is [1, 1], and the interquartile mean drops the two failures in eight that were looked for. The
posterior used instead is a Dirichlet process with a prior of total weight one. For a rate the
prior lays one half at 0 and one half at 1; each seed then weighs as much as the whole prior.

Monte Carlo generators are seeded by constants of this module and the data are sorted first, so
the same seeds in any order give the same numbers on the same NumPy build. With ``DRAWS`` draws
a p-value near 0.05 carries a standard error of 0.0005.

References
----------
Ferguson, T. S. (1973). A Bayesian analysis of some nonparametric problems. Annals of
Statistics 1(2), 209-230.
Rubin, D. B. (1981). The Bayesian bootstrap. Annals of Statistics 9(1), 130-134.
Brown, L. D., Cai, T. T. and DasGupta, A. (2001). Interval estimation for a binomial
proportion. Statistical Science 16(2), 101-133.
Holm, S. (1979). A simple sequentially rejective multiple test procedure. Scandinavian Journal
of Statistics 6(2), 65-70.
Agarwal, R. et al. (2021). Deep reinforcement learning at the edge of the statistical
precipice. NeurIPS 34.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

Floats: TypeAlias = npt.NDArray[np.float64]
"""A float64 array."""

RatesLike: TypeAlias = Sequence[float] | Floats
"""One number per training seed."""

DRAWS: Final = 200_000
"""Draws from every success-rate posterior."""

BOOTSTRAP_DRAWS: Final = 10_000
"""Resamples of the interquartile mean's bootstrap."""

_BLOCK: Final = 10_000  # draws made at one time
_ENTROPY: Final = 1973  # with the stream number, seeds every generator of this module
_STREAM_FIRST, _STREAM_SECOND, _STREAM_PAIRED, _STREAM_BOOTSTRAP = range(4)

# Prior atoms and their weights. A difference of pairs in [0, 1]² depends on a pair only through
# first − second, so pseudo-pairs at the corners (0, 1), (0, 0), (1, 1), (1, 0) of weight 1/4
# each are atoms at −1, 0 and 1 of weight 1/4, 1/2 and 1/4.
_RATE_PRIOR: Final = ((0.0, 1.0), (0.5, 0.5))
_PAIR_PRIOR: Final = ((-1.0, 0.0, 1.0), (0.25, 0.5, 0.25))


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
        return f"{self.estimate:z.2f} ({self.level:.0%} interval {ends})"


@dataclass(frozen=True)
class Difference:
    """A difference of two mean success rates (first minus second) and tests about it.

    The tests are one-sided posterior tail probabilities used as p-values, counted over the
    draws as (count + 1) / (draws + 1), so that none is ever exactly 0.

    Attributes
    ----------
    interval
        Difference of the plain means, with its posterior interval; dimensionless, in [-1, 1].
    draws
        Posterior draws of the difference, shape (draws,), read-only.
    """

    interval: Interval
    draws: Floats = field(repr=False, compare=False)

    def p_exceeds(self, margin: float) -> float:
        """P(difference <= margin): small when the difference is shown to exceed ``margin``."""
        return self._tail(int(np.count_nonzero(self.draws <= margin)))

    def p_greater(self, threshold: float = 0.0) -> float:
        """P(difference <= threshold): small when the first is shown to be the better one."""
        return self.p_exceeds(threshold)

    def p_less(self, threshold: float = 0.0) -> float:
        """P(difference >= threshold): small when the second is shown to be the better one."""
        return self._tail(int(np.count_nonzero(self.draws >= threshold)))

    def p_equivalent(self, margin: float) -> float:
        """Two one-sided tests: small when the difference is shown to lie within ±``margin``.

        Returns max(P(difference >= margin), P(difference <= -margin)) (Schuirmann 1987).

        Seeds that all succeed cannot rule out rare total failures, and here the prior is not
        strict enough to say so: where one seed in ten fails outright against perfect ones, a
        margin of 0.1 is called shown at 0.05 whenever no failure happens to turn up, with a
        chance of 0.9**seeds (0.21 for 15 unpaired seeds, 0.35 for 10 paired ones, the fewest
        that allow the claim; unpaired it is 0.05 at 30 and 0.08 at 40). For rates that
        vary smoothly between seeds the error was below the level in every case simulated.

        Raises
        ------
        ValueError
            If ``margin`` is not positive.
        """
        if not margin > 0.0:
            raise ValueError(f"expected an equivalence margin > 0, got {margin!r}")
        return max(self.p_less(margin), self.p_exceeds(-margin))

    def _tail(self, count: int) -> float:
        return (count + 1) / (self.draws.size + 1)


def rate_posterior(rates: RatesLike, *, draws: int = DRAWS) -> Floats:
    """Draw from the Dirichlet-process posterior of the mean success rate.

    Weights are Dirichlet with 1 for each seed and 1/2 for each of two pseudo-seeds, at 0 and
    at 1 (Ferguson 1973; without the pseudo-seeds it is the Bayesian bootstrap of Rubin 1981).

    Parameters
    ----------
    rates
        Shape (..., seeds): success rate of each training seed, in [0, 1]. Leading axes are
        independent data sets that share their weights.
    draws
        Number of draws.

    Returns
    -------
    Shape (draws, ...), dimensionless.

    Raises
    ------
    ValueError
        If there is no seed, or a rate is not finite or outside [0, 1].
    """
    return _posterior_of_mean(_checked_rates(rates, "rates"), _RATE_PRIOR, _STREAM_FIRST, draws)


def paired_posterior(first: RatesLike, second: RatesLike, *, draws: int = DRAWS) -> Floats:
    """Draw from the posterior of the mean of first − second over pairs.

    Weights are Dirichlet with 1 for each pair and 1/4 for each of four pseudo-pairs, at the
    corners of the unit square: prior weight one in all, and the prior of either member alone is
    that of `rate_posterior`.

    Parameters
    ----------
    first, second
        Shape (..., seeds), in [0, 1]: entry k of both belongs to training seed k.
    draws
        Number of draws.

    Returns
    -------
    Shape (draws, ...), dimensionless, in [-1, 1].

    Raises
    ------
    ValueError
        If the shapes differ, there is no seed, or a rate is not finite or outside [0, 1].
    """
    one, other = _checked_rates(first, "first"), _checked_rates(second, "second")
    if one.shape != other.shape:
        raise ValueError(
            f"paired rates need one value per seed on both sides, got shapes {one.shape} "
            f"and {other.shape}; for different policies use unpaired_difference"
        )
    return _posterior_of_mean(one - other, _PAIR_PRIOR, _STREAM_PAIRED, draws)


def unpaired_posterior(first: RatesLike, second: RatesLike, *, draws: int = DRAWS) -> Floats:
    """Draw from the posterior of mean(first) − mean(second), two independent groups of seeds.

    Parameters
    ----------
    first, second
        Shapes (..., seeds) and (..., other seeds), in [0, 1]; both have the same number of
        leading axes, and these broadcast.
    draws
        Number of draws.

    Returns
    -------
    Shape (draws, ...), dimensionless, in [-1, 1].

    Raises
    ------
    ValueError
        If a group has no seed, the shapes do not fit, or a rate is not finite or outside [0, 1].
    """
    one, other = _checked_rates(first, "first"), _checked_rates(second, "second")
    if one.ndim != other.ndim:
        raise ValueError(f"expected as many axes in both groups, got {one.shape}, {other.shape}")
    return _posterior_of_mean(one, _RATE_PRIOR, _STREAM_FIRST, draws) - _posterior_of_mean(
        other, _RATE_PRIOR, _STREAM_SECOND, draws
    )


def mean_rate(rates: RatesLike) -> float:
    """Plain mean of success rates of shape (seeds,), whatever their order.

    Raises
    ------
    ValueError
        If ``rates`` is empty or not one-dimensional, or a rate is not finite or outside [0, 1].
    """
    return _mean(_one_dimensional(rates, "rates"))


def rate_interval(rates: RatesLike, level: float = 0.95) -> Interval:
    """Interval for the mean success rate over training seeds.

    Equal-tailed interval of `rate_posterior`, stretched to the estimate where the prior pulls
    it past. When every seed is all or nothing, with k of n successes, the posterior is
    Beta(k + 1/2, n - k + 1/2) and the result the Jeffreys interval, which by its usual
    definition also ends at 0 for k = 0 and at 1 for k = n (Brown, Cai and DasGupta 2001). It
    has positive length even when all seeds agree.

    Like every interval of Jeffreys' kind it holds its level on average over the true rate, not
    at each one: with all-or-nothing seeds the coverage of a 95 % interval averages 0.957 (5
    seeds) and 0.953 (10), and falls to 0.89 and 0.87 at the least favourable rates. For rates
    with one smooth peak it was 0.95 or more in every case simulated.

    Parameters
    ----------
    rates
        Shape (seeds,): success rate of each training seed, in [0, 1].
    level
        Nominal coverage, in (0, 1).

    Returns
    -------
    Interval whose estimate is the plain mean over seeds.

    Raises
    ------
    ValueError
        If ``rates`` is empty or not one-dimensional, a rate is not finite or outside [0, 1], or
        ``level`` is outside (0, 1).
    """
    values = _one_dimensional(rates, "rates")
    return _equal_tailed(_mean(values), rate_posterior(values), level)


def paired_difference(home: RatesLike, away: RatesLike, level: float = 0.95) -> Difference:
    """Home drop: the same policies judged twice, home − away.

    Parameters
    ----------
    home, away
        Shape (seeds,), in [0, 1]: entry k of both belongs to training seed k.
    level
        Nominal coverage of the interval, in (0, 1).

    Raises
    ------
    ValueError
        As `paired_posterior` and `rate_interval`.
    """
    one, other = _one_dimensional(home, "home"), _one_dimensional(away, "away")
    draws = paired_posterior(one, other)
    return _difference(_mean(one) - _mean(other), draws, level)


def unpaired_difference(
    native: RatesLike, transferred: RatesLike, level: float = 0.95
) -> Difference:
    """Transfer gap: two groups of policies in one place, native − transferred.

    The groups may have different numbers of seeds; their posteriors are independent.

    Parameters
    ----------
    native, transferred
        Shapes (seeds,) and (other seeds,), in [0, 1].
    level
        Nominal coverage of the interval, in (0, 1).

    Raises
    ------
    ValueError
        As `rate_interval`.
    """
    one = _one_dimensional(native, "native")
    other = _one_dimensional(transferred, "transferred")
    draws = unpaired_posterior(one, other)
    return _difference(_mean(one) - _mean(other), draws, level)


def iqm(values: npt.ArrayLike) -> float:
    """Interquartile mean: the mean of the middle half of all values.

    For returns only, never for success: it deletes the lowest quarter, and with it the total
    failures a success rate is there to show (eight seeds, two of which always fail, have an
    interquartile success of 1.0). Of n values, floor(n/4) are dropped at either end (Agarwal et
    al. 2021).

    Parameters
    ----------
    values
        Any shape; units of the return.

    Raises
    ------
    ValueError
        If there are no values, or one is not finite.
    """
    array = np.asarray(values, dtype=np.float64).ravel()
    _require_finite(array, "values")
    return float(_middle_half_mean(array))


def iqm_interval(
    values: npt.ArrayLike, level: float = 0.95, *, draws: int = BOOTSTRAP_DRAWS
) -> Interval | None:
    """Interquartile mean of returns with a percentile bootstrap over training seeds.

    For returns only: see `iqm`. One cell of a panel is one task, hence one stratum of the
    stratified bootstrap of Agarwal et al. (2021): whole seeds are drawn with replacement, each
    with all its episodes, because the episodes of one policy are not independent. Such an
    interval is too short with few seeds (about 0.89 true coverage for a nominal 0.95 with five)
    and has no length when the seeds agree exactly.

    Parameters
    ----------
    values
        Shape (seeds, episodes); units of the return.
    level
        Nominal coverage, in (0, 1).
    draws
        Number of resamples.

    Returns
    -------
    The interval, or None with fewer than two seeds.

    Raises
    ------
    ValueError
        If ``values`` is not two-dimensional, is empty, or holds a value that is not finite, or
        ``level`` is outside (0, 1).
    """
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 2:
        raise ValueError(f"expected shape (seeds, episodes), got {array.shape}")
    _require_finite(array, "values")
    _check_level(level)
    if array.shape[0] < 2:
        return None
    return _equal_tailed(iqm(array), _bootstrap_iqm(array, draws), level)


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
    _check_level(level)
    finite = array[np.isfinite(array)]
    if finite.size < 2:
        return None
    mean = _mean(finite)
    spread = math.sqrt(math.fsum((finite - mean) ** 2) / (finite.size - 1) / finite.size)
    half = student_t_quantile(finite.size - 1, level) * spread
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
    _check_level(level)
    count = array.size
    if count < 2:
        return None
    tails = np.cumsum([math.comb(count, k) for k in range(count // 2)]) / 2.0**count
    covers = 1.0 - 2.0 * tails
    place = max(0, int(np.count_nonzero(covers >= level)) - 1)
    low, high = array[place], array[count - 1 - place]
    middle = array[(count - 1) // 2 : count // 2 + 1]
    return Interval(float(middle.mean()), float(low), float(high), float(covers[place]))


@lru_cache(maxsize=256)
def student_t_quantile(dof: int, level: float) -> float:
    """Two-sided quantile of Student's t: the t with P(|T| <= t) = level.

    For whole degrees of freedom the distribution is a finite trigonometric sum in
    θ = atan(t/√dof) (Abramowitz and Stegun 1964, 26.7.3 and 26.7.4), which is bisected.

    Raises
    ------
    ValueError
        If ``dof`` is below 1 or ``level`` is outside (0, 1).
    """
    if dof < 1:
        raise ValueError(f"expected at least 1 degree of freedom, got {dof}")
    _check_level(level)
    low, high = 0.0, math.pi / 2.0
    for _ in range(64):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _central_t(middle, dof) < level else (low, middle)
    return math.sqrt(dof) * math.tan(low)


def holm(p_values: RatesLike) -> Floats:
    """Adjust p-values for being one family, by Holm's step-down procedure (1979).

    The i-th smallest of m is multiplied by m − i + 1, made no smaller than those before it and
    capped at 1. Rejecting where the result is below α keeps the chance of any wrong rejection at
    α or less, whatever the dependence between the tests.

    Parameters
    ----------
    p_values
        Shape (m,), in [0, 1]; m may be 0.

    Returns
    -------
    Shape (m,), in the order given.

    Raises
    ------
    ValueError
        If ``p_values`` is not one-dimensional or a value is outside [0, 1].
    """
    p = np.asarray(p_values, dtype=np.float64)
    if p.ndim != 1:
        raise ValueError(f"expected p-values of shape (m,), got {p.shape}")
    if not np.all((p >= 0.0) & (p <= 1.0)):
        raise ValueError(f"expected p-values in [0, 1], got {p.tolist()}")
    order = np.argsort(p, kind="stable")
    stepped = np.maximum.accumulate(p[order] * np.arange(p.size, 0, -1))
    adjusted = np.empty_like(p)
    adjusted[order] = np.minimum(stepped, 1.0)
    return adjusted


def _posterior_of_mean(
    atoms: Floats,
    prior: tuple[tuple[float, ...], tuple[float, ...]],
    stream: int,
    draws: int,
) -> Floats:
    """Draws of the mean under Dirichlet weights, shape (draws, ...) for atoms (..., n)."""
    values, weights = prior
    batch, seeds = atoms.shape[:-1], atoms.shape[-1]
    support = np.concatenate(
        [np.sort(atoms, axis=-1), np.broadcast_to(values, (*batch, len(values)))], axis=-1
    )
    mass = _dirichlet(seeds, weights, stream, draws)
    return np.asarray(np.tensordot(mass, support, axes=(1, -1)))


@lru_cache(maxsize=4)
def _dirichlet(seeds: int, prior: tuple[float, ...], stream: int, draws: int) -> Floats:
    """Weights of ``seeds`` seeds and of the prior's atoms, shape (draws, seeds + atoms)."""
    rng = np.random.Generator(np.random.PCG64([_ENTROPY, stream]))
    mass = np.empty((draws, seeds + len(prior)))
    for start in range(0, draws, _BLOCK):
        block = mass[start : start + _BLOCK]
        block[:, :seeds] = rng.standard_exponential((len(block), seeds))
        block[:, seeds:] = rng.standard_gamma(prior, (len(block), len(prior)))
    mass /= mass.sum(axis=1, keepdims=True)
    mass.setflags(write=False)
    return mass


def _bootstrap_iqm(array: Floats, draws: int) -> Floats:
    """Interquartile means of resampled seeds, shape (draws,), for array (seeds, episodes)."""
    seeds, episodes = array.shape
    ordered = array[np.lexsort(array.T[::-1])]
    rng = np.random.Generator(np.random.PCG64([_ENTROPY, _STREAM_BOOTSTRAP]))
    chosen = rng.integers(seeds, size=(draws, seeds))
    block = max(1, 2_000_000 // (seeds * episodes))
    parts = [
        _middle_half_mean(ordered[chosen[start : start + block]].reshape(-1, seeds * episodes))
        for start in range(0, draws, block)
    ]
    return np.concatenate(parts)


def _middle_half_mean(values: Floats) -> Floats:
    """Mean over the last axis without its lowest and highest quarter."""
    size = values.shape[-1]
    cut = size // 4
    ordered = np.sort(values, axis=-1)
    return np.asarray(ordered[..., cut : size - cut].mean(axis=-1))


def _central_t(theta: float, dof: int) -> float:
    """P(|T| <= √dof·tan θ) for Student's t with ``dof`` degrees of freedom."""
    odd = dof % 2
    cosine = math.cos(theta)
    term, total = (cosine if odd else 1.0), 0.0
    for power in range(odd, dof - 1, 2):
        if power > odd:
            term *= cosine * cosine * (power - 1) / power
        total += term
    value = math.sin(theta) * total
    return 2.0 / math.pi * (theta + value) if odd else value


def _difference(estimate: float, draws: Floats, level: float) -> Difference:
    draws.setflags(write=False)
    return Difference(_equal_tailed(estimate, draws, level), draws)


def _equal_tailed(estimate: float, draws: Floats, level: float) -> Interval:
    """Equal-tailed interval of the draws, stretched where needed to hold the estimate."""
    _check_level(level)
    tail = 0.5 * (1.0 - level)
    low, high = np.quantile(draws, [tail, 1.0 - tail])
    return Interval(estimate, min(float(low), estimate), max(float(high), estimate), level)


def _mean(values: Floats) -> float:
    """Mean, correctly rounded before the division, so that order does not matter."""
    return math.fsum(values) / values.size


def _one_dimensional(rates: RatesLike, name: str) -> Floats:
    array = _checked_rates(rates, name)
    if array.ndim != 1:
        raise ValueError(f"expected {name} of shape (seeds,), got {array.shape}")
    return array


def _checked_rates(rates: RatesLike, name: str) -> Floats:
    array = np.asarray(rates, dtype=np.float64)
    if array.ndim < 1 or array.size == 0:
        raise ValueError(f"expected {name} with at least one training seed, got {array.shape}")
    wrong = array[~((array >= 0.0) & (array <= 1.0))]
    if wrong.size:
        raise ValueError(f"expected {name} in [0, 1], got {wrong.flat[0]}")
    return array


def _require_finite(array: Floats, name: str) -> None:
    if array.size == 0:
        raise ValueError(f"expected at least one value in {name}, got none")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"expected finite {name}, got {array[~np.isfinite(array)][0]}")


def _check_level(level: float) -> None:
    if not 0.0 < level < 1.0:
        raise ValueError(f"expected a level in (0, 1), got {level!r}")
