"""Intervals for returns and other scalars."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import stats

from integ_gym.eval.statistics import Estimate, iqm, iqm_interval, mean_interval


def test_iqm_deletes_total_failures() -> None:
    assert iqm([1.0] * 6 + [0.0] * 2) == 1.0


def test_iqm_interval_agrees_with_all_resamples() -> None:
    values = np.array([[0.0, 1.0], [4.0, 6.0], [10.0, 11.0]])
    every = [iqm(values[list(rows)]) for rows in itertools.product(range(3), repeat=3)]
    found = iqm_interval(values, 0.8)
    assert found is not None
    assert found.estimate == iqm(values)
    assert found.low == pytest.approx(np.quantile(every, 0.1, method="inverted_cdf"))
    assert found.high == pytest.approx(np.quantile(every, 0.9, method="inverted_cdf"))


def test_iqm_interval_resamples_whole_seeds() -> None:
    rng = np.random.default_rng(5)
    values = rng.normal(size=(10, 1)) + 0.01 * rng.normal(size=(10, 50))
    whole, scattered = iqm_interval(values), iqm_interval(rng.permuted(values.ravel())[:, None])
    assert whole is not None
    assert scattered is not None
    assert whole.high - whole.low > 3.0 * (scattered.high - scattered.low)


def test_iqm_interval_does_not_depend_on_seed_order() -> None:
    values = np.random.default_rng(6).normal(size=(7, 300))
    assert iqm_interval(values[::-1]) == iqm_interval(values)
    assert iqm_interval(values[:1]) is None


@pytest.mark.parametrize("size", [2, 3, 4, 30, 200])
def test_mean_interval_is_student_t(size: int) -> None:
    values = np.concatenate((np.random.default_rng(size).normal(size=size), [np.nan, np.inf]))
    finite = values[:size]
    found = mean_interval(values, 0.9)
    low, high = stats.t.interval(0.9, size - 1, finite.mean(), stats.sem(finite))
    assert found is not None
    assert (found.estimate, found.low, found.high) == pytest.approx((finite.mean(), low, high))


def test_mean_interval_needs_two_finite_seeds() -> None:
    assert mean_interval([]) is None
    assert mean_interval([3.0, float("nan"), float("inf")]) is None
    assert mean_interval([3.0, 3.0]) == Estimate(3.0, 3.0, 3.0, 0.95)
