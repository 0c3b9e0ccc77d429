"""Looks at a run that grows share the level, whatever there is to see."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import binom

from integ_gym.eval.power import (
    Comparison,
    Verdict,
    fewest_seeds,
    judge_family,
    seeds_wanted,
    verdict_chances,
)
from integ_gym.eval.verdict import (
    FIRST_SHARE,
    Achieved,
    Looks,
    Rates,
    Shares,
    adjust_for_look,
    fewest_for_equivalence,
    p_overfitting_within,
    share_of_look,
)

SOLVED = Achieved("achievable")


def _judged(
    seeds: int, lost: int, before: tuple[int, ...], planned: tuple[int, ...] = ()
) -> Verdict:
    """So many seeds of which some always fail elsewhere, and all others always succeed."""
    there = np.r_[np.zeros(lost), np.ones(seeds - lost)]
    rates = Rates(np.ones(seeds), there, there, np.ones(seeds), np.ones(100))
    (judged,) = judge_family(
        [Comparison("x", "j", rates, SOLVED)], Looks(before, planned), draws=20_000
    )
    return judged


def _wrong(looks: tuple[int, ...], planned: tuple[int, ...] = ()) -> float:
    """Chance of `transfers` at any look where one seed in ten is lost, exactly."""
    chances, before, total = np.array([1.0]), 0, 0.0
    for place, seeds in enumerate(looks):
        added = binom.pmf(np.arange(seeds - before + 1), seeds - before, 0.1)
        chances, before = np.convolve(chances, added), seeds
        for lost in range(seeds + 1):
            if _judged(seeds, lost, looks[:place], planned).verdict != "transfers":
                break
            total += float(chances[lost])
            chances[lost] = 0.0
    return total


@pytest.mark.parametrize(
    ("looks", "planned", "chance"),
    [
        ((30, 42, 52, 64), (), 0.012),
        ((10, 23, 36, 49, 62, 75, 88, 100), (), 0.023),
        ((31,), (31,), 0.038),
        ((42, 52, 64), (42,), 0.012),
        ((30, 42, 52, 64), (30, 42, 52, 64), 0.011),
    ],
)
def test_a_wrong_verdict_at_any_look_is_as_rare_as_at_one(looks, planned, chance):
    """Without spending the first two are 0.072 and 0.063."""
    assert _wrong(looks, planned) == pytest.approx(chance, abs=0.008 if planned else 0.006)


def test_all_looks_together_have_the_level():
    shares = [share_of_look(number) for number in range(1, 40)]
    assert shares[:3] == [0.75, 0.125, 0.0625]
    assert sum(shares) == pytest.approx(1.0)
    assert all(later < before for before, later in pairwise(shares))


def test_a_look_spends_nothing_on_a_test_that_is_not_made():
    first = Looks().shares(42)
    assert first == Shares(0.75, 0.75)
    assert Looks((4, 3)).shares(42) == first
    assert Looks((10, 32)).shares(42).equivalent == first.equivalent
    assert Looks((10, 32)).shares(42).exceeds == share_of_look(3)
    assert Looks().shares(32) == Shares(0.75, 0.0)
    assert Looks().shares(4).levels == (0.0, 0.0)


def test_planned_looks_share_the_whole_level_and_others_have_none():
    alone = Looks(planned=(42,))
    assert alone.shares(42) == Shares(1.0, 1.0)
    assert alone.shares(41) == Shares(0.0, 0.0)
    assert alone.then(41).shares(42) == Shares(1.0, 1.0)
    assert alone.then(42).shares(42) == Shares(0.0, 0.0)
    assert alone.then(42).shares(64) == Shares(0.0, 0.0)
    three = Looks(planned=(10, 33, 64))
    assert three.shares(10) == Shares(pytest.approx(1 / 3), 0.0)
    assert three.then(10).shares(33) == Shares(pytest.approx(1 / 3), 0.5)
    assert three.then(10).then(50).then(33).shares(64) == Shares(pytest.approx(1 / 3), 0.5)


def test_looks_at_the_same_policies_elsewhere_are_paid_for():
    assert Looks((Shares(0.75, 0.0),)).shares(42) == Shares(0.125, 0.75)
    assert Looks((Shares(1.0, 1.0),)).shares(42) == Shares(0.0, 0.0)
    assert Looks((Shares(0.75, 0.75), 42)).shares(52) == Shares(0.0625, 0.0625)
    assert Looks((Shares(0.75, 0.5),), (42,)).shares(42) == Shares(0.25, 0.5)


@pytest.mark.parametrize("share", [FIRST_SHARE, 1.0])
def test_equivalence_is_tested_from_the_first_number_of_seeds_on_that_can_show_it(share):
    fewest = fewest_for_equivalence(share)
    assert fewest == {FIRST_SHARE: 33, 1.0: 30}[share]
    for seeds, shown in ((fewest - 1, False), (fewest, True)):
        p = p_overfitting_within(Rates(*(np.ones(seeds),) * 3), 0.1)
        assert (p < 0.05 * share) == shown
    assert fewest_seeds(1) == 33
    assert fewest_seeds(1, Looks(planned=(42,))) == 30


def test_one_planned_look_decides_more_than_a_first_of_many():
    solved = Rates(*(np.ones(31),) * 3)
    (first,) = judge_family([Comparison("x", "j", solved, SOLVED)], draws=20_000)
    (planned,) = judge_family(
        [Comparison("x", "j", solved, SOLVED)], Looks((), (31,)), draws=20_000
    )
    assert (first.verdict, planned.verdict) == ("inconclusive", "transfers")
    assert planned.p_equivalent_adjusted == planned.p_equivalent
    (unplanned,) = judge_family(
        [Comparison("x", "j", solved, SOLVED)], Looks((), (64,)), draws=20_000
    )
    assert unplanned.verdict == "inconclusive"


def test_adjusted_p_values_are_held_against_the_whole_level():
    assert adjust_for_look(0.02, 0.5) == 0.04
    assert adjust_for_look(0.6, 0.5) == 1.0
    assert adjust_for_look(0.0001, 0.0) == 1.0
    first, later = _judged(50, 0, ()), _judged(50, 0, (42,))
    assert first.p_equivalent == later.p_equivalent
    assert first.p_equivalent_adjusted == pytest.approx((first.p_equivalent or 0.0) / 0.75)
    assert later.p_equivalent_adjusted == pytest.approx((first.p_equivalent or 0.0) * 8.0)
    few = _judged(32, 0, ())
    assert few.p_equivalent_adjusted == 1.0
    assert few.seeds_for_transfers == 33


def test_what_more_seeds_can_show_counts_the_looks_before():
    assert fewest_seeds(2, Looks((42,))) > fewest_seeds(2) + 10
    between = np.r_[np.zeros(1), np.ones(41)]
    rates = Rates(np.ones(42), between, between)
    first, third = seeds_wanted(rates, 1), seeds_wanted(rates, 1, Looks((36, 42)))
    assert first is not None
    assert third is not None
    assert third > first
    assert seeds_wanted(rates, 1, Looks((42,), (42, third))) == third
    assert seeds_wanted(rates, 1, Looks((42,), (42,))) is None
    alone, later = (
        verdict_chances(44, 44, 20, 1, Looks(before), repeats=8) for before in ((), (42,))
    )
    assert alone[0].transfers[1] > 0.7
    assert later[0].transfers[1] == 0.0
