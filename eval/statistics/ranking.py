"""Does one place rank policies as another does?"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from .interval import Floats, Interval, equal_tailed
from .streams import Stream, generator

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
    judged: Floats,
    true: Floats,
    seeds: npt.NDArray[np.int64],
    level: float = 0.95,
    *,
    draws: int = RANKING_DRAWS,
) -> tuple[Interval | None, Interval]:
    """Correlation and mean maximum rank violation, with bootstrap intervals over seeds.

    Policies of one seed act from the same starts, so that whole seeds are resampled.

    Parameters
    ----------
    judged, true
        Shape (policies,), success rates in [0, 1].
    seeds
        Shape (policies,): which policies belong together.
    level
        Nominal coverage, in (0, 1).
    draws
        Number of resamples.

    Returns
    -------
    The correlation, None where it does not exist, and the violation.
    """
    rng = generator(Stream.BOOTSTRAP)
    groups = [np.flatnonzero(seeds == seed) for seed in np.unique(seeds)]
    found = []
    for _ in range(draws):
        chosen = np.concatenate([groups[k] for k in rng.integers(len(groups), size=len(groups))])
        one, other = judged[chosen], true[chosen]
        found.append((pearson(one, other), rank_violation(one, other)))
    correlations, violations = np.array(found).T
    correlations = correlations[np.isfinite(correlations)]
    whole = pearson(judged, true)
    known = correlations.size > 0 and np.isfinite(whole)
    return (
        equal_tailed(whole, correlations, level) if known else None,
        equal_tailed(rank_violation(judged, true), violations, level),
    )
