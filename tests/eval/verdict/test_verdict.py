"""Verdicts: every branch of the three decision rules, on seeds whose answer is known."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from integ_gym.eval.power import Comparison, Verdict, judge_family
from integ_gym.eval.statistics import holm, unpaired_difference
from integ_gym.eval.verdict import (
    FIRST_SHARE,
    Achieved,
    Attempt,
    CellRole,
    PolicyCell,
    PolicyComparison,
    Rates,
    Search,
    achieved,
    compare_policies,
    p_overfitting_within,
    reference_class,
    share_of_look,
    split,
)

SOLVED = Achieved("achievable")
GOOD, POOR, MIDDLE = [1.0, 0.95] * 5, [0.1, 0.2] * 5, [0.75, 0.85] * 5
ZERO = [0.0] * 10


def rates(
    home: list[float],
    native: list[float] | None,
    transferred: list[float],
    recovered: list[float] | None = None,
    handmade: list[float] | None = None,
) -> Rates:
    return Rates(
        home, transferred, transferred if recovered is None else recovered, native, handmade
    )


def judge(given: Rates, cell: Achieved = SOLVED) -> Verdict:
    (found,) = judge_family([Comparison("only", "j", given, cell)])
    return found


def cell(name: str, a: list[float], b: list[float], role: CellRole | None = None) -> PolicyCell:
    return PolicyCell(name, a, b, role)


def claim(
    *coarse: PolicyCell,
    quarter: tuple[list[float], list[float]] = (GOOD, POOR),
    reference: tuple[list[float], list[float]] = (GOOD, POOR),
) -> PolicyComparison:
    return compare_policies(
        [
            *coarse,
            cell("quarter", *quarter, "quarter_step"),
            cell("truth", *reference, "reference"),
        ]
    )


# --- judge_family --------------------------------------------------------------------------


def test_transfers() -> None:
    many = [1.0, 0.95, 0.98] * 15
    for native, handmade in ((many, None), (None, [1.0] * 100), (many, [1.0] * 100)):
        found = judge(rates(many, native, many, handmade=handmade))
        assert found.verdict == "transfers"
        assert found.p_equivalent_adjusted is not None
        assert found.p_equivalent_adjusted < 0.05


HARD = [0.55, 0.65] * 20


@pytest.mark.parametrize(
    ("given", "verdict", "parts"),
    [
        (rates([1.0] * 40, HARD, HARD), "transfers", (0.4, 0.0, 0.0)),
        (rates([1.0] * 40, [1.0] * 40, HARD), "fails", (0.0, 0.0, 0.4)),
        (rates([1.0] * 40, HARD, HARD, handmade=[1.0] * 100), "fails", (0.0, 0.0, 0.4)),
        (rates([1.0] * 48, [1.0] * 48, [0.2] * 48, [1.0] * 48), "transfers", (0.0, 0.8, 0.0)),
        (rates(GOOD, GOOD, MIDDLE), "inconclusive", (0.0, 0.0, 0.175)),
        (rates([0.6] * 40, [0.6] * 40, [1.0] * 40), "inconclusive", (0.0, 0.0, -0.4)),
        (rates([1.0] * 4, [1.0] * 40, [0.0] * 4), "inconclusive", None),
        (rates([1.0] * 40, [1.0] * 4, [0.0] * 40), "inconclusive", None),
        (rates([1.0] * 4, None, [0.0] * 4), "inconclusive", None),
        (rates([1.0] * 8, [1.0] * 8, [0.0] * 8), "fails", (0.0, 0.0, 1.0)),
        (rates([0.9, 0.1] * 5, None, ZERO), "inconclusive", (0.0, 0.0, 0.5)),
    ],
    ids=["natives lose it too", "natives do not", "nor the hand-made", "a deadline", "between",
         "better than everybody", "few", "few natives", "few alone", "eight", "half at home"],
)  # fmt: skip
def test_losses_are_split_and_judged(given: Rates, verdict: str, parts: Any) -> None:
    """Parts are difficulty, deadline and overfitting; without them there are too few seeds."""
    found = judge(given)
    assert found.verdict == verdict
    assert found.few == (parts is None)
    if parts is not None:
        split_up = (found.difficulty, found.deadline, found.overfitting)
        assert [part.estimate for part in split_up] == pytest.approx(parts, abs=1e-12)
        assert found.total.estimate == pytest.approx(sum(parts))


def test_not_learned_gets_a_mark_and_leaves_the_family() -> None:
    family = [
        Comparison("not", "j", rates([0.5, 0.49] * 5, GOOD, MIDDLE), SOLVED),
        Comparison("learned", "j", rates(GOOD, GOOD, [0.3, 0.7] * 5), SOLVED),
    ]
    not_learned, learned = judge_family(family)
    assert not_learned.verdict == "not_learned"
    assert not_learned.p_exceeds is None
    assert not_learned.p_equivalent_adjusted is None
    with_both = judge_family([Comparison("not", "j", rates(GOOD, GOOD, MIDDLE), SOLVED), family[1]])
    assert learned.p_exceeds is not None
    assert learned.p_exceeds_adjusted == pytest.approx(learned.p_exceeds / FIRST_SHARE)
    assert with_both[1].p_exceeds_adjusted == pytest.approx(2.0 * learned.p_exceeds / FIRST_SHARE)


@pytest.mark.parametrize("status", ["too_slow", "unachievable", "undecided"])
def test_cells_that_are_not_achievable_are_marked_and_leave_the_family_if_known(
    status: Any,
) -> None:
    failing = rates([1.0] * 10, None, ZERO)
    marked, judged = judge_family(
        [
            Comparison("marked", "j", failing, Achieved(status)),
            Comparison("judged", "j", failing, SOLVED),
        ]
    )
    assert (marked.verdict, marked.p_exceeds) == (status, None)
    assert judged.verdict == "fails"
    assert judged.p_exceeds is not None
    counted = 2.0 if status == "undecided" else 1.0
    assert judged.p_exceeds_adjusted == pytest.approx(counted * judged.p_exceeds / FIRST_SHARE)


def test_each_test_is_corrected_over_the_family() -> None:
    borderline = [0.5, 0.3, 0.55, 0.4] * 3
    family = [
        Comparison(f"c{k}", "j", rates(GOOD + GOOD[:2], GOOD, borderline), SOLVED) for k in range(6)
    ]
    family.append(Comparison("few", "j", rates(GOOD[:3], None, POOR[:3]), SOLVED))
    alone, found = judge_family(family[:1]), judge_family(family)
    assert alone[0].verdict == "fails"
    assert found[0].verdict == "inconclusive"
    assert [f.row for f in found] == [c.row for c in family]
    exceeds = holm([f.p_exceeds for f in found if f.p_exceeds is not None]) / FIRST_SHARE
    assert [f.p_exceeds_adjusted for f in found] == [*np.minimum(exceeds[:-1], 1.0), 1.0]
    many = judge_family(
        [Comparison(f"c{k}", "j", rates([1.0] * 40, None, [1.0] * 40), SOLVED) for k in range(3)]
    )
    equivalent = holm([f.p_equivalent for f in many if f.p_equivalent is not None]) / FIRST_SHARE
    assert [f.p_equivalent_adjusted for f in many] == equivalent.tolist()
    assert {f.p_equivalent_adjusted for f in found} == {1.0}, "12 seeds are too few to test it"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([rates(GOOD, None, GOOD)] * 2, "'a → j' more than once"),
        ([rates([], None, [])], "at least one training seed"),
        ([rates(GOOD, [2.0], GOOD)], r"in \[0, 1\], got 2.0"),
    ],
)
def test_bad_family(given: list[Rates], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        judge_family([Comparison("a", "j", own, SOLVED) for own in given])
    with pytest.raises(ValueError, match="got 10, 9 and 9 seeds"):
        rates(GOOD, None, GOOD[:-1])
    assert judge_family([]) == ()


# --- loss ----------------------------------------------------------------------------------

a_rate = st.floats(0.0, 1.0)
policies = st.lists(st.tuples(a_rate, a_rate, a_rate), min_size=1, max_size=12)
others = st.none() | st.lists(a_rate, min_size=1, max_size=12)


@given(rows=policies, native=others, handmade=others)
@settings(max_examples=25, deadline=None, derandomize=True)
def test_parts_add_up_to_the_loss(rows: Any, native: Any, handmade: Any) -> None:
    home, transferred, recovered = (list(column) for column in zip(*rows, strict=True))
    loss = split(Rates(home, transferred, recovered, native, handmade), draws=2000)
    parts = (loss.difficulty, loss.deadline, loss.overfitting)
    assert sum(part.estimate for part in parts) == pytest.approx(loss.total.estimate, abs=1e-12)
    assert loss.total.estimate == pytest.approx(np.mean(home) - np.mean(transferred), abs=1e-12)
    assert all(part.low <= part.estimate <= part.high for part in (*parts, loss.total))


@pytest.mark.parametrize("seeds", [30, 47])
def test_perfect_seeds_are_equivalent_as_far_as_their_number_goes(seeds: int) -> None:
    """As many seeds as the docstring of `judge_family` says, and the binomial chance."""
    perfect = rates([1.0] * seeds, [1.0] * seeds, [1.0] * seeds, handmade=[1.0] * 200)
    assert p_overfitting_within(perfect, 0.1) == pytest.approx(0.9 ** (seeds - 1), abs=3e-3)


def test_equal_yardsticks_do_not_make_a_transfer_of_a_loss_at_the_margin() -> None:
    """Many all-or-nothing seeds, 0.6 at home and of natives, 0.5 there: at most 5 % transfer."""
    rng, wrong = np.random.default_rng(5), 0
    for _ in range(200):
        home, native, there = (list((rng.random(200) < r).astype(float)) for r in (0.6, 0.6, 0.5))
        found = Rates(home, there, there, native)
        wrong += p_overfitting_within(found, 0.1, draws=2000) < 0.05
    assert wrong <= 17  # of 200 at 5 %, more have a chance of 0.01


# --- achievability -------------------------------------------------------------------------

LOST = Search(20.0, 10.0, (4.0, 4.9, 3.0), "searched")
FOUND = Search(20.0, 10.0, (11.0, 10.0, 3.0), "searched")


@pytest.mark.parametrize(
    ("attempts", "search", "expected"),
    [
        ([(0.5, 0.6)], LOST, ("achievable", 0, None)),
        ([(0.1, 0.4), (0.7, 0.7)], None, ("achievable", 1, None)),
        ([(0.1, 0.9)], LOST, ("too_slow", 0, None)),
        ([(0.0, 0.0)], LOST, ("unachievable", None, LOST)),
        ([], LOST, ("unachievable", None, LOST)),
        ([(0.0, 0.2)], FOUND, ("undecided", 0, None)),
        ([], None, ("undecided", None, None)),
    ],
)
def test_achievability(
    attempts: list[tuple[float, float]], search: Search | None, expected: tuple[Any, ...]
) -> None:
    made = [Attempt(str(k), *rates) for k, rates in enumerate(attempts)]
    status, best, found = expected
    attempt = None if best is None else made[best]
    assert achieved(made, search) == Achieved(status, attempt, found)


# --- reference_class -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("s_cell", "s_reference", "expected"),
    [
        (0.9, 0.9, "true_pass"),
        (0.9, 0.1, "false_pass"),
        (0.1, 0.9, "false_fail"),
        (0.1, 0.1, "true_fail"),
        (0.5, 0.49, "false_pass"),
    ],
)
def test_reference_class(s_cell: float, s_reference: float, expected: str) -> None:
    assert reference_class(s_cell, s_reference) == expected


# --- compare_policies ----------------------------------------------------------------------


FEW = (GOOD[:4], POOR)
BARELY = (ZERO, [0.04] * 10)


@pytest.mark.parametrize(
    ("coarse", "deciding", "outcome", "statuses"),
    [
        ((GOOD, GOOD), {}, "accepted", ["undecided", "win", "win"]),
        ((POOR, GOOD), {}, "rejected", ["reversal", "win", "win"]),
        ((GOOD, POOR), {"quarter": (GOOD, GOOD)}, "rejected", ["win", "undecided", "win"]),
        ((GOOD, POOR), {"reference": (GOOD, GOOD)}, "rejected", ["win", "win", "undecided"]),
        ((GOOD, POOR), {"reference": BARELY}, "rejected", ["win", "win", "unsolved"]),
        (BARELY, {}, "accepted", ["unsolved", "win", "win"]),
        (BARELY, {"quarter": BARELY, "reference": BARELY}, "uninformative", ["unsolved"] * 3),
        ((ZERO, [0.8] * 10), {}, "rejected", ["reversal", "win", "win"]),
        ((GOOD, GOOD), {"reference": FEW}, "uninformative", ["undecided", "win", "too_few_seeds"]),
        ((POOR[:4], GOOD[:4]), {}, "accepted", ["too_few_seeds", "win", "win"]),
        ((POOR, GOOD), {"reference": FEW}, "rejected", ["reversal", "win", "too_few_seeds"]),
    ],
)
def test_a_claim_is_decided_where_it_must_hold_and_reversed_anywhere(
    coarse: Any, deciding: Any, outcome: str, statuses: list[str]
) -> None:
    found = claim(cell("coarse", *coarse), **deciding)
    assert found.outcome == outcome
    assert [one.status for one in found.cells] == statuses


def test_reversals_are_corrected_over_the_informative_cells() -> None:
    """One borderline reversal rejects alone, but not as one of many cells looked at."""
    a, b = [0.55, 0.6, 0.5, 0.4, 0.5, 0.5, 0.5, 0.5], [0.9, 0.95, 0.8, 1.0, 0.9, 0.8, 0.9, 0.9]
    p = unpaired_difference(a, b).p_less()
    assert 0.05 / 10 < p / FIRST_SHARE < 0.05 / 3
    assert claim(cell("one", a, b)).outcome == "rejected"
    others = [cell(f"other{k}", GOOD, GOOD) for k in range(7)]
    found = claim(cell("one", a, b), *others, *[cell("dead", ZERO, ZERO)])
    assert found.outcome == "accepted"
    assert found.cells[0].p_reversal == p
    assert found.cells[0].p_reversal_adjusted == pytest.approx(10 * p / FIRST_SHARE)


def test_a_win_that_is_seen_again_must_be_clearer() -> None:
    a, b = [0.8, 0.9, 0.7, 0.9, 0.8, 0.85, 0.75, 0.9], [0.5, 0.45, 0.6, 0.5, 0.4, 0.55, 0.5, 0.6]
    first, later = (
        compare_policies(
            [cell("fine", a, b, "quarter_step"), cell("truth", a, b, "reference")], share
        )
        for share in (share_of_look(1), share_of_look(4))
    )
    assert (first.outcome, later.outcome) == ("accepted", "rejected")
    assert later.cells[0].p_win == first.cells[0].p_win
    assert later.cells[0].p_win_adjusted == pytest.approx(24 * (first.cells[0].p_win_adjusted or 0))


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        ([cell("a", GOOD, POOR, "reference")], "quarter_step"),
        ([cell("a", GOOD, POOR, "quarter_step")], "reference"),
        ([cell("a", GOOD, POOR, "quarter_step"), cell("a", GOOD, POOR, "reference")], "'a' more"),
        ([cell("a", [], POOR, "quarter_step"), cell("b", GOOD, POOR, "reference")], "at least one"),
    ],
)
def test_bad_cells(cells: list[PolicyCell], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        compare_policies(cells)
