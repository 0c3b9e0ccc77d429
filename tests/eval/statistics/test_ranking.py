"""Agreement of rankings: extremes, a case by hand, and invariance."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from integ_gym.eval.statistics import pearson, rank_violation, ranking_intervals

rates = st.lists(st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)), min_size=2, max_size=12)


def _violation_by_loops(judged, true):
    worst = []
    for i in range(len(judged)):
        mistaken = [
            abs(true[i] - true[j])
            for j in range(len(judged))
            if (judged[i] < judged[j]) != (true[i] < true[j])
        ]
        worst.append(max(mistaken, default=0.0))
    return sum(worst) / len(worst)


@given(rates)
def test_violation_is_what_loops_say(pairs):
    judged, true = np.array(pairs).T
    assert rank_violation(judged, true) == pytest.approx(_violation_by_loops(judged, true))


@given(rates, st.randoms(use_true_random=False))
def test_order_of_policies_does_not_matter(pairs, random):
    shuffled = random.sample(pairs, len(pairs))
    for measure in (rank_violation, pearson):
        one, other = (measure(*np.array(given_pairs).T) for given_pairs in (pairs, shuffled))
        assert one == pytest.approx(other, nan_ok=True, abs=1e-6)


def test_extremes():
    rates = np.array([0.1, 0.4, 0.9])
    assert rank_violation(rates, rates) == 0.0
    assert rank_violation(rates, rates**2) == 0.0
    assert rank_violation(rates, rates[::-1]) == pytest.approx((0.8 + 0.5 + 0.8) / 3)
    assert pearson(rates, 1.0 - rates) == pytest.approx(-1.0)
    assert math.isnan(pearson(np.ones(3), rates))


def test_intervals_hold_the_estimate_and_narrow_with_seeds():
    rng = np.random.default_rng(0)
    lengths = []
    for seeds in (8, 80):
        quality = rng.random(seeds)
        judged, true = (np.clip(quality + 0.1 * rng.standard_normal(seeds), 0, 1) for _ in "ab")
        correlation, violation = ranking_intervals(judged, true, np.arange(seeds))
        assert correlation is not None
        assert correlation.low <= correlation.estimate <= correlation.high
        assert correlation.estimate == pytest.approx(np.corrcoef(judged, true)[0, 1])
        assert 0.0 <= violation.low <= violation.estimate <= violation.high <= 1.0
        lengths.append(correlation.high - correlation.low)
    assert lengths[1] < lengths[0]


def test_policies_that_are_all_alike_have_no_correlation():
    correlation, violation = ranking_intervals(np.ones(6), np.linspace(0, 1, 6), np.arange(6) // 2)
    assert correlation is None
    assert violation.estimate > 0.0
