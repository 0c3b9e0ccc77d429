"""Looks at a run that grows share the level, whatever there is to see."""

import importlib.util
import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom

from integ_gym.eval.power import (
    OVERFITTING,
    WORLDS,
    Comparison,
    Verdict,
    draw_measured_rates,
    fewest_seeds,
    judge_family,
    postpone,
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
    p_overfitting_exceeds,
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
    rates = draw_measured_rates(np.random.default_rng(0), draw, mean, 4000, 20)
    assert rates.shape == (4000,)
    assert rates.mean() == pytest.approx(mean, abs=0.03)


def test_a_postponed_verdict_tells_no_p_value():
    rates = Rates(*(np.ones(40),) * 3)
    (judged,) = judge_family([Comparison("x", "j", rates, SOLVED)])
    later = postpone(judged)
    assert (judged.verdict, later.verdict) == ("transfers", "inconclusive")
    assert (later.p_exceeds, later.p_equivalent, later.p_equivalent_adjusted) == (None, None, None)
    assert later.overfitting == judged.overfitting
    (mark,) = judge_family([Comparison("x", "j", rates, Achieved("too_slow"))])
    assert postpone(mark) == mark


SCRIPT = Path(__file__).parents[3] / "benchmarks" / "recomputed.py"
_spec = importlib.util.spec_from_file_location("recomputed", SCRIPT)
assert _spec is not None
assert _spec.loader is not None
recomputed = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(recomputed)

DRAWS = 20_000


@pytest.mark.parametrize("handmade", [None, np.ones(50)])
@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_p_values_follow_from_the_documentation(loss, handmade):
    rng = np.random.default_rng(3)
    home, native = (rng.binomial(20, 0.97, 40) / 20 for _ in range(2))
    there = rng.binomial(20, 0.97 - loss, 40) / 20
    rates = Rates(home, there, there, native, handmade)
    yardsticks = [native] if handmade is None else [native, handmade]
    row = np.stack([home, there], axis=1)
    for margin, weight in ((0.2, 0.6), (-0.1, 1.0)):
        theirs = recomputed.p_exceeds(rng, row, yardsticks, margin, weight, DRAWS)
        ours = p_overfitting_exceeds(rates, margin, weight, draws=DRAWS)
        assert theirs == pytest.approx(ours, abs=0.01)
    theirs = recomputed.p_within(rng, row, yardsticks, 0.1, DRAWS)
    assert theirs == pytest.approx(p_overfitting_within(rates, 0.1, draws=DRAWS), abs=0.01)


def test_shares_follow_from_the_documentation():
    looks = (4, 10, 33, 42, 52, 64)
    for now, seeds in enumerate(looks):
        ours = Looks(looks[:now]).shares(seeds)
        assert recomputed.share_at(looks, now, 5) == ours.exceeds
        assert recomputed.share_at(looks, now, 33) == ours.equivalent
        ours = Looks(looks[:now], looks[1:]).shares(seeds)
        planned = [recomputed.share_planned(looks, now, least) for least in (5, 30)]
        assert planned == pytest.approx([ours.exceeds, ours.equivalent])


def test_the_script_imports_nothing_of_the_package():
    assert "integ_gym" not in SCRIPT.read_text(encoding="utf-8")


def test_verdicts_of_a_run_follow_from_its_records(panel_directory, capsys):
    recomputed.verdicts(panel_directory)
    lines = capsys.readouterr().out.splitlines()
    told = json.loads((panel_directory / "panel.json").read_text(encoding="utf-8"))["verdicts"]
    assert told
    for one in told:
        place = next(i for i, x in enumerate(lines) if f"{one['row']} → {one['cell']}:" in x)
        verdict = lines[place].split(": ")[1].split(",")[0]
        assert verdict == lines[place + 1].split(": ")[1].split(",")[0] == one["verdict"]


def test_failures_where_nobody_can_win_say_nothing_of_loops(tmp_path, monkeypatch, capsys):
    cells = {"rk4": "achievable", "reference": "achievable", "closed": "unachievable"}
    success = {"rk4": [1.0, 0.0], "reference": [0.0, 1.0], "closed": [0.0, 0.0]}
    panel = {
        "rows": [{"name": "row", "kind": "trained", "learned": True}],
        "cells": [{"name": x, "kind": "grid", "achievability": can} for x, can in cells.items()],
        "matrix": [{"row": "row", "cell": x, "success_by_seed": y} for x, y in success.items()],
    }
    (tmp_path / "panel.json").write_text(json.dumps(panel), encoding="utf-8")
    monkeypatch.setattr(recomputed, "radii", lambda *_: np.array([0.9, 0.5]))
    recomputed.loops(tmp_path)
    told = capsys.readouterr().out
    assert "all cells: 6 loops, 6 stable, of which 4 fail" in told
    assert "cells that can be won: 4 loops, 4 stable, of which 2 fail; area 0.50" in told
