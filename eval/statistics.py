"""Intervals and tests over training seeds and starts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property, lru_cache
from typing import Final, TypeAlias

import msgspec
import numpy as np
import numpy.typing as npt

from integ_gym.support.errors import InputError
from integ_gym.support.optional import load
from integ_gym.support.terminal import fixed, percent

Floats: TypeAlias = npt.NDArray[np.float64]
"""A float64 array."""

RatesLike: TypeAlias = Sequence[float] | Floats
"""One number per training seed."""

LEVEL: Final = 0.95
"""Nominal coverage of an interval, unless another one is asked for."""


class Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A part of ``panel.json``: immutable, and of a file it must say all that is asked for."""


class Estimate(Part, frozen=True):
    """A number with a two-sided interval over training seeds, in the unit of what it estimates.

    Where a policy was given, the interval is over its episodes: this policy, these starts.

    Attributes:
        estimate: point estimate from the seeds alone (no prior in it); inside the interval.
        low: lower end of the interval; null where there is none or it is not bounded.
        high: upper end of the interval; null as the lower.
        level: nominal coverage of the interval, in (0, 1); null without one.
    """

    estimate: float
    low: float | None = None
    high: float | None = None
    level: float | None = None

    @property
    def bounded(self) -> bool:
        """Whether both ends are known."""
        return self.low is not None and self.high is not None

    @property
    def ends(self) -> tuple[float, float]:
        """Both ends; the estimate itself where an end is unknown."""
        return (
            self.estimate if self.low is None else self.low,
            self.estimate if self.high is None else self.high,
        )

    def is_within(self, margin: float) -> bool:
        """Whether the whole interval is within a margin on either side of zero."""
        low, high = self.ends
        return self.bounded and -margin <= low and high <= margin

    def __str__(self) -> str:
        return self.in_words()

    def in_words(self, digits: int = 2, *, level: bool = False, more: str = "") -> str:
        """The estimate, and in brackets its interval, its level if asked for, and what is more."""
        ends = " to ".join(fixed(end, digits) for end in self.ends) if self.bounded else ""
        if level and ends and self.level:
            ends = f"{percent(self.level)} interval {ends}"
        inner = "; ".join(filter(None, (ends, more)))
        text = fixed(self.estimate, digits)
        return f"{text} ({inner})" if inner else text


class Median(Part, frozen=True, kw_only=True):
    """Median over seeds of what may not be reached; null where it is not.

    Attributes:
        estimate: the median; seeds that never got there count as longest.
        low: lower end of its interval.
        high: upper end of its interval.
        level: nominal coverage of the interval, in (0, 1).
    """

    estimate: float | None
    low: float | None
    high: float | None
    level: float


def equal_tailed(estimate: float, draws: Floats, level: float = LEVEL) -> Estimate:
    """Equal-tailed interval of the draws, stretched where needed to hold the estimate."""
    check_level(level)
    tail = 0.5 * (1.0 - level)
    low, high = np.quantile(draws, [tail, 1.0 - tail])
    estimate = float(estimate)
    return Estimate(estimate, min(float(low), estimate), max(float(high), estimate), level)


def mean_of(values: Floats) -> float:
    """Mean, correctly rounded before the division, so that order does not matter."""
    return math.fsum(values) / values.size


def one_dimensional(rates: RatesLike, name: str) -> Floats:
    """Success rates of shape (seeds,), checked."""
    array = check_rates(rates, name)
    if array.ndim != 1:
        raise InputError(f"expected {name} of shape (seeds,), got {array.shape}")
    return array


def check_rates(rates: RatesLike, name: str) -> Floats:
    """Success rates of shape (..., seeds), checked to be in [0, 1]."""
    array = np.asarray(rates, dtype=np.float64)
    if array.ndim < 1 or array.size == 0:
        raise InputError(f"expected {name} with at least one training seed, got {array.shape}")
    wrong = array[~((array >= 0.0) & (array <= 1.0))]
    if wrong.size:
        raise InputError(f"expected {name} in [0, 1], got {wrong.flat[0]}")
    return array


def require_finite(array: Floats, name: str) -> None:
    """Refuse an empty array and values that are not finite."""
    if array.size == 0:
        raise InputError(f"expected at least one value in {name}, got none")
    if not np.all(np.isfinite(array)):
        raise InputError(f"expected finite {name}, got {array[~np.isfinite(array)][0]}")


def check_level(level: float) -> None:
    """Refuse a nominal coverage outside (0, 1)."""
    if not 0.0 < level < 1.0:
        raise InputError(f"expected a level in (0, 1), got {level!r}")


def mean_interval(values: RatesLike, level: float = LEVEL) -> Estimate | None:
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
        raise InputError(f"expected values of shape (seeds,), got {array.shape}")
    check_level(level)
    finite = array[np.isfinite(array)]
    if finite.size < 2:
        return None
    mean = mean_of(finite)
    spread = math.sqrt(math.fsum((finite - mean) ** 2) / (finite.size - 1) / finite.size)
    quantile = load("scipy.special", "report").stdtrit(finite.size - 1, 0.5 * (1.0 + level))
    half = float(quantile) * spread
    return Estimate(mean, mean - half, mean + half, level)


def median_interval(values: RatesLike) -> Median | None:
    """Median over training seeds between two order statistics, whatever the distribution.

    Infinity stands for "not within the time there was": such seeds count as larger than all
    others, and an end or the median itself is None where too many are. The order statistics
    X(k) and X(n + 1 − k) with the largest k that covers the median often enough are taken; with
    fewer than 6 seeds even the extremes do not reach 95 %, and the level says what they reach.

    Parameters
    ----------
    values
        Shape (seeds,), one value per seed in any unit; infinities are allowed, NaN is not.

    Returns
    -------
    The median with the level that holds exactly for a continuous distribution, or None with
    fewer than two values.

    Raises
    ------
    ValueError
        If ``values`` is not one-dimensional or has a NaN.
    """
    array = np.sort(np.asarray(values, dtype=np.float64))
    if array.ndim != 1 or np.isnan(array).any():
        raise InputError(f"expected values of shape (seeds,) without NaN, got {values!r}")
    count = array.size
    if count < 2:
        return None
    tails = np.cumsum([math.comb(count, k) for k in range(count // 2)]) / 2.0**count
    covers = 1.0 - 2.0 * tails
    place = max(0, int(np.count_nonzero(covers >= LEVEL)) - 1)
    low, high = array[place], array[count - 1 - place]
    middle = array[(count - 1) // 2 : count // 2 + 1]
    found = (float(x) if math.isfinite(x) else None for x in (middle.mean(), low, high))
    estimate, lowest, highest = found
    return Median(estimate=estimate, low=lowest, high=highest, level=float(covers[place]))


_ENTROPY: Final = 1973


class Stream(IntEnum):
    """What a stream is for; streams are independent."""

    FIRST = 0
    SECOND = 1
    PAIRED = 2
    BOOTSTRAP = 3
    THIRD = 4


def generator(stream: Stream, prior: bool = False) -> np.random.Generator:
    """A new generator at the beginning of a stream, or of its own for what a prior adds."""
    return np.random.Generator(np.random.PCG64([_ENTROPY, stream, int(prior)]))


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
        raise InputError(f"expected p-values of shape (m,), got {p.shape}")
    if not np.all((p >= 0.0) & (p <= 1.0)):
        raise InputError(f"expected p-values in [0, 1], got {p.tolist()}")
    order = np.argsort(p, kind="stable")
    stepped = np.maximum.accumulate(p[order] * np.arange(p.size, 0, -1))
    adjusted = np.empty_like(p)
    adjusted[order] = np.minimum(stepped, 1.0)
    return adjusted


DRAWS: Final = 200_000
"""Draws from every posterior and for every test."""

# Prior atoms and their weights. A difference of pairs in [0, 1]² depends on a pair only through
# first − second, so pseudo-pairs at the corners (0, 1), (0, 0), (1, 1), (1, 0) of weight 1/4
# each are atoms at −1, 0 and 1 of weight 1/4, 1/2 and 1/4.
_RATE_PRIOR: Final = ((0.0, 1.0), (0.5, 0.5))
_PAIR_PRIOR: Final = ((-1.0, 0.0, 1.0), (0.25, 0.5, 0.25))


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
    return _posterior_of_mean(check_rates(rates, "rates"), _RATE_PRIOR, Stream.FIRST, draws)


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
    one, other = check_rates(first, "first"), check_rates(second, "second")
    if one.shape != other.shape:
        raise InputError(
            f"paired rates need one value per seed on both sides, got shapes {one.shape} "
            f"and {other.shape}; for different policies use unpaired_difference"
        )
    return _posterior_of_mean(one - other, _PAIR_PRIOR, Stream.PAIRED, draws)


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
    one, other = check_rates(first, "first"), check_rates(second, "second")
    if one.ndim != other.ndim:
        raise InputError(f"expected as many axes in both groups, got {one.shape}, {other.shape}")
    return _posterior_of_mean(one, _RATE_PRIOR, Stream.FIRST, draws) - _posterior_of_mean(
        other, _RATE_PRIOR, Stream.SECOND, draws
    )


def joint_means(
    columns: Floats,
    atoms: Floats,
    weights: tuple[float, ...],
    stream: Stream,
    *,
    draws: int = DRAWS,
) -> Floats:
    """Means of several quantities of the same seeds, under Dirichlet weights that they share.

    Parameters
    ----------
    columns
        Shape (quantities, seeds): row q holds quantity q of every seed.
    atoms
        Shape (quantities, atoms): what the prior's pseudo-seeds have.
    weights
        Weight of each pseudo-seed; that of a seed is 1.
    stream
        Groups of seeds that are independent have streams of their own.
    draws
        Number of draws.

    Returns
    -------
    Shape (draws, quantities).
    """
    ordered = columns[:, np.lexsort(columns[::-1])]
    return _weighted_means(ordered, atoms, weights, stream, draws)


def _posterior_of_mean(
    atoms: Floats,
    prior: tuple[tuple[float, ...], tuple[float, ...]],
    stream: Stream,
    draws: int,
) -> Floats:
    """Draws of the mean under Dirichlet weights, shape (draws, ...) for atoms (..., n)."""
    values, weights = prior
    batch = atoms.shape[:-1]
    flat = np.sort(atoms, axis=-1).reshape(-1, atoms.shape[-1])
    pseudo = np.broadcast_to(values, (len(flat), len(values)))
    means = _weighted_means(flat, pseudo, weights, stream, draws)
    return means.reshape(draws, *batch)


_FEW_ROWS: Final = 3


def _weighted_means(
    rows: Floats, atoms: Floats, weights: tuple[float, ...], stream: Stream, draws: int
) -> Floats:
    """Means of rows (rows, seeds) with atoms (rows, atoms), shape (draws, rows)."""
    _, total = _seed_weights(rows.shape[1], stream, draws)
    prior, pseudo = _prior_weights(weights, stream, draws)
    # Sums of few rows are kept: each of a comparison's tests has a prior of its own, and these.
    sum_rows = _sum_rows if len(rows) <= _FEW_ROWS else _sum_rows.__wrapped__
    means = sum_rows(rows.tobytes(), len(rows), stream, draws) + prior @ atoms.T
    means /= (total + pseudo)[:, None]
    return means


@lru_cache(maxsize=12)
def _sum_rows(rows: bytes, count: int, stream: Stream, draws: int) -> Floats:
    """Weighted sums of rows (count, seeds), shape (draws, count), before prior and division."""
    array = np.frombuffer(rows, np.float64).reshape(count, -1)
    seeds, _ = _seed_weights(array.shape[1], stream, draws)
    return np.asarray(seeds @ array.T)


@lru_cache(maxsize=6)
def _seed_weights(seeds: int, stream: Stream, draws: int) -> tuple[Floats, Floats]:
    """Weights before their division by the sum, shape (draws, seeds), and the sums."""
    weights = generator(stream).standard_exponential((draws, seeds))
    weights.setflags(write=False)
    return weights, weights.sum(axis=1)


@lru_cache(maxsize=16)
def _prior_weights(weights: tuple[float, ...], stream: Stream, draws: int) -> tuple[Floats, Floats]:
    """The same of the prior's atoms."""
    drawn = generator(stream, prior=True).standard_gamma(weights, (draws, len(weights)))
    drawn.setflags(write=False)
    return drawn, drawn.sum(axis=1)


SHOWN: Final = 0.6
"""Weight of the pseudo-seed in a test that one mean exceeds another by a margin: in all worlds
simulated (`benchmarks/error_rates.py`) this keeps the level, with more power than 1."""

PROVEN: Final = 1.0
"""The same in a test of equivalence, where rare total failures that do not turn up must count."""


def worst_case_means(
    columns: Floats, worst: Sequence[float], weight: float, stream: Stream, *, draws: int = DRAWS
) -> Floats:
    """Draw means of several quantities of the same seeds, with one pseudo-seed at the worst.

    Weights are Dirichlet with 1 for each seed and ``weight`` for a pseudo-seed that has what
    speaks most against a claim. The share of draws that contradict the claim is its p-value.
    With weight 1 this is the test of Gaffke (2005; as a bound of the mean, Learned-Miller and
    Thomas 2020): where seeds are all or nothing it is the exact binomial test of Clopper and
    Pearson (1934), and for other seeds on a bounded range no case is known in which its level is
    exceeded.

    Parameters
    ----------
    columns, stream, draws
        As in `joint_means`.
    worst
        Shape (quantities,): what the pseudo-seed has.
    weight
        Of the pseudo-seed.

    Returns
    -------
    Shape (draws, quantities).
    """
    atoms = np.asarray(worst, dtype=np.float64)[:, None]
    return joint_means(columns, atoms, (weight,), stream, draws=draws)


def difference_draws(
    first: Floats, second: Floats, worst: float, weight: float, *, draws: int = DRAWS
) -> Floats:
    """Draws of mean(first) − mean(second) of two independent groups, shape (draws,).

    Parameters
    ----------
    first, second
        Shapes (seeds,) and (other seeds,).
    worst
        What speaks most against the claim: a pseudo-seed of −1 or of 1.
    weight
        Of the pseudo-seeds, one in each group.
    draws
        Number of draws.
    """
    low, high = (0.0, 1.0) if worst < 0.0 else (1.0, 0.0)
    one = worst_case_means(first[None], (low,), weight, Stream.FIRST, draws=draws)
    return (one - worst_case_means(second[None], (high,), weight, Stream.SECOND, draws=draws))[:, 0]


def p_equivalent(first: RatesLike, second: RatesLike, margin: float) -> float:
    """Small when two independent groups' mean rates are shown to differ by less than a margin.

    Two one-sided tests, of which the larger p-value counts (Schuirmann 1987).

    Raises
    ------
    ValueError
        If ``margin`` is not positive, or as `rate_interval`.
    """
    if not margin > 0.0:
        raise InputError(f"expected an equivalence margin > 0, got {margin!r}")
    one, other = one_dimensional(first, "first"), one_dimensional(second, "second")
    return max(
        share(difference_draws(one, other, 1.0, PROVEN) >= margin),
        share(difference_draws(one, other, -1.0, PROVEN) <= -margin),
    )


def share(contradicting: npt.NDArray[np.bool_]) -> float:
    """Share of draws that contradict a claim, counted as (count + 1) / (draws + 1): never 0."""
    return (int(np.count_nonzero(contradicting)) + 1) / (contradicting.size + 1)


@dataclass(frozen=True)
class Difference:
    """A difference of two mean success rates (first minus second) and tests about it.

    The tests do not use the interval's prior: each puts a pseudo-seed where it speaks most
    against what is to be shown (see `worst_case_means`), so that they hold their level for seeds
    that are all or nothing as well. No p-value is ever exactly 0.

    Attributes
    ----------
    interval
        Difference of the plain means, with its posterior interval; dimensionless, in [-1, 1].
    with_worst
        Draws of the difference with the pseudo-seed at a value and of a weight, shape (draws,).
    """

    interval: Estimate
    with_worst: Callable[[float, float], Floats] = field(repr=False, compare=False)

    @cached_property
    def lowered(self) -> Floats:
        """Draws of the difference with the pseudo-seed at −1, shape (draws,)."""
        return self.with_worst(-1.0, SHOWN)

    @cached_property
    def raised(self) -> Floats:
        """The same with it at 1."""
        return self.with_worst(1.0, SHOWN)

    def p_greater(self, margin: float = 0.0, weight: float = SHOWN) -> float:
        """Small when the difference is shown to exceed ``margin``.

        Parameters
        ----------
        margin
            In [-1, 1].
        weight
            Of the pseudo-seed; with 1, where the same seeds are judged twice, it is the test of
            Gaffke (2005).
        """
        lowered = self.lowered if weight == SHOWN else self.with_worst(-1.0, weight)
        return share(lowered <= margin)

    def p_less(self, margin: float = 0.0) -> float:
        """Small when the difference is shown to be below ``margin``."""
        return share(self.raised >= margin)


def mean_rate(rates: RatesLike) -> float:
    """Plain mean of success rates of shape (seeds,), whatever their order.

    Raises
    ------
    ValueError
        If ``rates`` is empty or not one-dimensional, or a rate is not finite or outside [0, 1].
    """
    return mean_of(one_dimensional(rates, "rates"))


def rate_interval(rates: RatesLike, level: float = LEVEL, *, draws: int = DRAWS) -> Estimate:
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
    draws
        Draws of its posterior.

    Returns
    -------
    Interval whose estimate is the plain mean over seeds.

    Raises
    ------
    ValueError
        If ``rates`` is empty or not one-dimensional, a rate is not finite or outside [0, 1], or
        ``level`` is outside (0, 1).
    """
    values = one_dimensional(rates, "rates")
    return equal_tailed(mean_of(values), rate_posterior(values, draws=draws), level)


def paired_difference(home: RatesLike, away: RatesLike, level: float = LEVEL) -> Difference:
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
    one, other = one_dimensional(home, "home"), one_dimensional(away, "away")
    posterior = paired_posterior(one, other)
    drop = (one - other)[None]
    return Difference(
        equal_tailed(mean_of(one) - mean_of(other), posterior, level),
        lambda worst, weight: worst_case_means(drop, [worst], weight, Stream.PAIRED)[:, 0],
    )


def unpaired_difference(
    native: RatesLike, transferred: RatesLike, level: float = LEVEL, *, draws: int = DRAWS
) -> Difference:
    """Transfer gap: two groups of policies in one place, native − transferred.

    The groups may have different numbers of seeds; their posteriors are independent.

    Parameters
    ----------
    native, transferred
        Shapes (seeds,) and (other seeds,), in [0, 1].
    level
        Nominal coverage of the interval, in (0, 1).
    draws
        From the posterior, and for each test.

    Raises
    ------
    ValueError
        As `rate_interval`.
    """
    one = one_dimensional(native, "native")
    other = one_dimensional(transferred, "transferred")
    posterior = unpaired_posterior(one, other, draws=draws)
    return Difference(
        equal_tailed(mean_of(one) - mean_of(other), posterior, level),
        lambda worst, weight: difference_draws(one, other, worst, weight, draws=draws),
    )


BOOTSTRAP_DRAWS: Final = 10_000
"""Resamples of the interquartile mean's bootstrap."""


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
    array = np.sort(np.asarray(values, dtype=np.float64), axis=None)
    require_finite(array, "values")
    return float(load("scipy.stats", "report").trim_mean(array, 0.25))


def iqm_interval(values: npt.ArrayLike, level: float = LEVEL) -> Estimate | None:
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
        raise InputError(f"expected shape (seeds, episodes), got {array.shape}")
    require_finite(array, "values")
    check_level(level)
    if array.shape[0] < 2:
        return None
    return equal_tailed(iqm(array), _bootstrap_iqm(array), level)


def _bootstrap_iqm(array: Floats) -> Floats:
    """Interquartile means of resampled seeds, shape (BOOTSTRAP_DRAWS,), for (seeds, episodes)."""
    stats = load("scipy.stats", "report")
    ordered = array[np.lexsort(array.T[::-1])]

    def iqm_of(chosen: npt.NDArray[np.intp], axis: int) -> Floats:
        drawn = ordered[chosen].reshape(*chosen.shape[:-1], array.size)
        return np.asarray(stats.trim_mean(drawn, 0.25, axis=-1))

    found = stats.bootstrap(
        (np.arange(len(ordered)),),
        iqm_of,
        n_resamples=BOOTSTRAP_DRAWS,
        batch=max(1, 2_000_000 // array.size),
        vectorized=True,
        method="percentile",
        rng=generator(Stream.BOOTSTRAP),
    )
    return np.asarray(found.bootstrap_distribution)


FLIPS: Final = 10_000
"""Draws of signs in a test of paired returns."""

_MOST_NUMBERS: Final = 10_000_000
"""Largest array of draws, in numbers."""


def draws_for(units: int, most: int = DRAWS) -> int:
    """Draws that fit the memory for so many units of replication: fewer where these are many."""
    return max(1000, min(most, _MOST_NUMBERS // max(1, units)))


def highest_share(count: int, of: int) -> float:
    """Upper end of the one-sided exact 95 % interval for a share (Clopper and Pearson 1934)."""
    if count >= of:
        return 1.0
    return float(load("scipy.stats", "report").beta.ppf(0.95, count + 1, of - count))


def paired_success(first: RatesLike, second: RatesLike) -> tuple[Estimate, float]:
    """Success of one policy in two places from the same starts: first − second.

    The unit of replication is the episode, so the interval and the test are about this policy and
    starts like these. The test is the exact sign test of the episodes that end differently, which
    for successes and failures is McNemar's (1947).

    Parameters
    ----------
    first, second
        Shape (episodes,), in [0, 1]: entry k of both has the same start.

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
    interval = equal_tailed(mean_of(one) - mean_of(other), posterior)
    more, count = np.count_nonzero(one > other), np.count_nonzero(one != other)
    binomial = load("scipy.stats", "report").binomtest
    return interval, float(binomial(int(more), int(count)).pvalue) if count else 1.0


def paired_return(first: RatesLike, second: RatesLike) -> tuple[Estimate | None, float]:
    """Returns of one policy in two places from the same starts: mean of first − second.

    Parameters
    ----------
    first, second
        Shape (episodes,), in any unit: entry k of both has the same start.

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
        raise InputError(
            f"paired returns need one value per start on both sides, got shapes {one.shape} and "
            f"{other.shape}"
        )
    differences = one - other
    require_finite(differences, "returns")
    return mean_interval(differences), _flip_test(differences)


def unpaired_return(first: RatesLike, second: RatesLike) -> tuple[Estimate, float]:
    """Difference of the mean returns of two independent groups, first − second.

    Parameters
    ----------
    first, second
        Shapes (n,) and (m,), in any unit.

    Returns
    -------
    The difference with Welch's interval (1947), without ends of a group of one; and the two-sided
    p-value of its test, 1 where there is none.

    Raises
    ------
    ValueError
        If a group is empty, or a value is not finite.
    """
    one, other = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    for array, name in ((one, "first"), (other, "second")):
        require_finite(array, name)
    estimate = mean_of(one) - mean_of(other)
    if min(one.size, other.size) < 2 or max(np.ptp(one), np.ptp(other)) == 0.0:
        return Estimate(estimate), 1.0
    found = load("scipy.stats", "report").ttest_ind(one, other, equal_var=False)
    low, high = found.confidence_interval(LEVEL)
    return Estimate(estimate, float(low), float(high), LEVEL), float(found.pvalue)


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


_SAME: Final = 1e-9
"""Success rates that differ by less are the same."""

RANKING_DRAWS: Final = 400
"""Resamples of the seeds for an interval about an agreement of rankings."""


def rank_violation(judged: Floats, true: Floats) -> float:
    """Mean maximum rank violation (Li et al. 2024), in [0, 1]; 0 where both rank alike.

    Of every policy, how much better or worse it truly is than the one whose order to it is
    mistaken by most; the mean over policies.

    Parameters
    ----------
    judged, true
        Shape (policies,): success where they are judged, and where it counts.
    """
    order = judged[:, None] < judged
    mistaken = order != (true[:, None] < true)
    return float(np.where(mistaken, np.abs(true[:, None] - true), 0.0).max(axis=1).mean())


def pearson(judged: Floats, true: Floats) -> float:
    """Correlation coefficient; NaN where either is the same for all policies."""
    if min(np.ptp(judged), np.ptp(true)) < _SAME:
        return float("nan")
    return float(np.corrcoef(judged, true)[0, 1])


def ranking_intervals(
    judged: Floats, true: Floats, seeds: npt.NDArray[np.int64]
) -> tuple[Estimate | None, Estimate]:
    """Correlation and mean maximum rank violation, with bootstrap intervals over seeds.

    Policies of one seed act from the same starts, so that whole seeds are resampled.

    Parameters
    ----------
    judged, true
        Shape (policies,), success rates in [0, 1].
    seeds
        Shape (policies,): which policies belong together.

    Returns
    -------
    The correlation, None where it does not exist, and the violation.
    """
    rng = generator(Stream.BOOTSTRAP)
    groups = [np.flatnonzero(seeds == seed) for seed in np.unique(seeds)]
    found = []
    for _ in range(RANKING_DRAWS):
        chosen = np.concatenate([groups[k] for k in rng.integers(len(groups), size=len(groups))])
        one, other = judged[chosen], true[chosen]
        found.append((pearson(one, other), rank_violation(one, other)))
    correlations, violations = np.array(found).T
    correlations = correlations[np.isfinite(correlations)]
    whole = pearson(judged, true)
    known = correlations.size > 0 and np.isfinite(whole)
    return (
        equal_tailed(whole, correlations) if known else None,
        equal_tailed(rank_violation(judged, true), violations),
    )
