"""Paired episodes of one policy: exact tests, intervals that hold the estimate."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from integ_gym.eval.statistics import draws_for, paired_return, paired_success

flags = st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=60)


@given(flags)
@settings(deadline=None, max_examples=30)
def test_success_is_tested_exactly_and_the_interval_holds_the_difference(pairs):
    one, other = np.array(pairs, dtype=float).T
    interval, p = paired_success(one, other)
    assert interval.low <= interval.estimate <= interval.high
    assert interval.estimate == pytest.approx(one.mean() - other.mean())
    more, less = int((one > other).sum()), int((one < other).sum())
    exact = stats.binomtest(more, more + less).pvalue if more + less else 1.0
    assert p == pytest.approx(exact)


def test_one_policy_that_fails_elsewhere_is_shown_to():
    """0.975 at home and 0.10 elsewhere over 40 starts: no doubt about this policy."""
    home = np.array([1.0] * 39 + [0.0])
    away = np.array([1.0] * 4 + [0.0] * 36)
    interval, p = paired_success(home, away)
    assert 0.7 < interval.low < 0.875 < interval.high < 0.96
    assert p < 1e-6


def test_returns_are_compared_start_by_start():
    random = np.random.default_rng(0)
    starts = 100.0 * random.normal(size=30)
    interval, p = paired_return(starts + 1.0, starts + 0.1 * random.normal(size=30))
    assert interval is not None
    assert 0.9 < interval.low < interval.high < 1.1
    assert p == pytest.approx(1e-4, rel=0.01)
    same, p = paired_return(starts, starts)
    assert same is not None
    assert (same.low, same.high, p) == (0.0, 0.0, 1.0)
    assert paired_return([1.0], [0.0])[0] is None


@pytest.mark.parametrize("wrong", [([1.0, 2.0], [1.0]), ([np.nan], [1.0]), ([], [])])
def test_returns_that_cannot_be_paired_are_refused(wrong):
    with pytest.raises(ValueError):
        paired_return(*wrong)


def test_the_random_signs_keep_their_level():
    random = np.random.default_rng(1)
    values = [paired_return(random.normal(size=12), np.zeros(12))[1] for _ in range(300)]
    assert np.mean(np.array(values) < 0.05) < 0.09


def test_draws_fit_the_memory():
    assert draws_for(10) == 200_000
    assert draws_for(10_000) == 1000
    assert draws_for(0) == 200_000
