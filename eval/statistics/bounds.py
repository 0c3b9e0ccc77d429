"""Draws for tests that hold their level whatever the seeds are like."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from .interval import Floats, RatesLike, one_dimensional
from .posterior import DRAWS, joint_means
from .streams import Stream

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
        raise ValueError(f"expected an equivalence margin > 0, got {margin!r}")
    one, other = one_dimensional(first, "first"), one_dimensional(second, "second")
    return max(
        share(difference_draws(one, other, 1.0, PROVEN) >= margin),
        share(difference_draws(one, other, -1.0, PROVEN) <= -margin),
    )


def share(contradicting: npt.NDArray[np.bool_]) -> float:
    """Share of draws that contradict a claim, counted as (count + 1) / (draws + 1): never 0."""
    return (int(np.count_nonzero(contradicting)) + 1) / (contradicting.size + 1)
