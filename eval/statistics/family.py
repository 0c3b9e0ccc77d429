"""P-values of one family of tests."""

from __future__ import annotations

import numpy as np

from .interval import Floats, RatesLike


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
