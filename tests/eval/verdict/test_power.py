"""Power: what is stated agrees with the verdicts themselves."""

from __future__ import annotations

import numpy as np
import pytest

from integ_gym.eval.power import (
    OVERFITTING,
    WORLDS,
    Comparison,
    fewest_seeds,
    judge_family,
    measured,
    postponed,
    seeds_wanted,
    verdict_chances,
)
from integ_gym.eval.verdict import Achieved, Rates

SOLVED = Achieved("achievable")


def _perfect(seeds: int, family: int) -> set[str]:
    rates = Rates(*(np.ones(seeds),) * 3)
    comparisons = [Comparison(str(k), "j", rates, SOLVED) for k in range(family)]
    return {judged.verdict for judged in judge_family(comparisons)}


@pytest.mark.parametrize("family", [1, 3])
def test_the_fewest_seeds_are_those_from_which_perfect_families_transfer(family):
    fewest = fewest_seeds(family)
    assert _perfect(fewest + 1, family) == {"transfers"}
    assert _perfect(fewest - 2, family) == {"inconclusive"}


def test_chances_follow_overfitting_and_seeds():
    few, many = verdict_chances(8, 8, 20, 1, repeats=12), verdict_chances(60, 60, 20, 1, repeats=12)
    assert tuple(one.overfitting for one in many) == OVERFITTING
    assert few[0].transfers == (0.0, 0.0), "eight seeds cannot show it"
    assert many[0].transfers[1] > 0.8
    assert many[-1].fails[0] > 0.8
    for one in (*few, *many):
        for low, high in (one.transfers, one.fails):
            assert 0.0 <= low <= high <= 1.0
        assert one.transfers[1] + one.fails[0] <= 1.0
    assert many[0].fails == many[-1].transfers == (0.0, 0.0)


def test_wanted_seeds_decide_what_fewer_do_not():
    wanted = seeds_wanted(Rates(*(np.ones(12),) * 3), 1)
    assert wanted is not None
    assert _perfect(12, 1) == {"inconclusive"}
    assert _perfect(wanted, 1) == {"transfers"}
    between = np.r_[np.ones(17), np.zeros(3)]
    assert seeds_wanted(Rates(np.ones(20), between, between), 1, repeats=20) is None


@pytest.mark.parametrize("draw", WORLDS.values(), ids=WORLDS)
@pytest.mark.parametrize("mean", [0.0, 0.3, 0.9, 1.0])
def test_worlds_have_the_mean_that_is_asked(draw, mean):
    rates = measured(np.random.default_rng(0), draw, mean, 4000, 20)
    assert rates.shape == (4000,)
    assert rates.mean() == pytest.approx(mean, abs=0.03)


def test_a_postponed_verdict_tells_no_p_value():
    rates = Rates(*(np.ones(40),) * 3)
    (judged,) = judge_family([Comparison("x", "j", rates, SOLVED)])
    later = postponed(judged)
    assert (judged.verdict, later.verdict) == ("transfers", "inconclusive")
    assert (later.p_exceeds, later.p_equivalent, later.p_equivalent_adjusted) == (None, None, None)
    assert later.overfitting == judged.overfitting
    (mark,) = judge_family([Comparison("x", "j", rates, Achieved("too_slow"))])
    assert postponed(mark) == mark
