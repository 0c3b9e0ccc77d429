"""Draws of mean success rates under Dirichlet weights: posteriors, and bounds for tests."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np

from .interval import Floats, RatesLike, checked_rates
from .streams import Stream, generator

DRAWS: Final = 200_000
"""Draws from every posterior and for every test."""

# Prior atoms and their weights. A difference of pairs in [0, 1]² depends on a pair only through
# first − second, so pseudo-pairs at the corners (0, 1), (0, 0), (1, 1), (1, 0) of weight 1/4
# each are atoms at −1, 0 and 1 of weight 1/4, 1/2 and 1/4.
_RATE_PRIOR: Final = ((0.0, 1.0), (0.5, 0.5))
_PAIR_PRIOR: Final = ((-1.0, 0.0, 1.0), (0.25, 0.5, 0.25))

_FEW_ROWS: Final = 3


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
    return _posterior_of_mean(checked_rates(rates, "rates"), _RATE_PRIOR, Stream.FIRST, draws)


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
    one, other = checked_rates(first, "first"), checked_rates(second, "second")
    if one.shape != other.shape:
        raise ValueError(
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
    one, other = checked_rates(first, "first"), checked_rates(second, "second")
    if one.ndim != other.ndim:
        raise ValueError(f"expected as many axes in both groups, got {one.shape}, {other.shape}")
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


def _weighted_means(
    rows: Floats, atoms: Floats, weights: tuple[float, ...], stream: Stream, draws: int
) -> Floats:
    """Means of rows (rows, seeds) with atoms (rows, atoms), shape (draws, rows)."""
    _, total = _seed_weights(rows.shape[1], stream, draws)
    prior, pseudo = _prior_weights(weights, stream, draws)
    means = _seed_sums(rows, stream, draws) + prior @ atoms.T
    means /= (total + pseudo)[:, None]
    return means


def _seed_sums(rows: Floats, stream: Stream, draws: int) -> Floats:
    """Weighted sums of rows (rows, seeds), shape (draws, rows), before prior and division."""
    if len(rows) <= _FEW_ROWS:
        return _kept_sums(rows.tobytes(), len(rows), stream, draws)
    seeds, _ = _seed_weights(rows.shape[1], stream, draws)
    return np.asarray(seeds @ rows.T)


@lru_cache(maxsize=12)
def _kept_sums(rows: bytes, count: int, stream: Stream, draws: int) -> Floats:
    """The same of few rows: each of a comparison's tests has a prior of its own, and these."""
    array = np.frombuffer(rows, np.float64).reshape(count, -1)
    seeds, _ = _seed_weights(array.shape[1], stream, draws)
    sums = seeds @ array.T
    sums.setflags(write=False)
    return sums


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
