"""Verdicts: every branch of the three decision rules, on seeds whose answer is known."""

import dataclasses
import json

import pytest

from integ_gym.eval.statistics.family import holm
from integ_gym.eval.statistics.rates import paired_difference, unpaired_difference
from integ_gym.eval.verdict.comparison import (
    CellRole,
    PolicyCell,
    PolicyComparison,
    compare_policies,
)
from integ_gym.eval.verdict.family import Comparison, Judgement, judge_family
from integ_gym.eval.verdict.reference import reference_class

GOOD, POOR, MIDDLE = [1.0, 0.95] * 5, [0.1, 0.2] * 5, [0.75, 0.85] * 5
ZERO = [0.0] * 10


def judge(home: list[float], native: list[float] | None, transferred: list[float]) -> Judgement:
    (found,) = judge_family([Comparison("only", home, native, transferred)])
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


def test_fails_on_the_transfer_gap() -> None:
    found = judge(GOOD, GOOD, POOR)
    assert (found.verdict, found.quantity) == ("fails", "transfer_gap")
    difference = unpaired_difference(GOOD, POOR)
    assert found.gap == difference.interval
    assert found.p_exceeds == difference.p_exceeds(0.2)
    assert found.p_equivalent == difference.p_equivalent(0.1)
    for number in ("0.15", "0.97", "0.82", "10 native", "10 transferred", "p < 0.001"):
        assert number in found.reason


def test_fails_on_the_home_drop_where_nobody_trained() -> None:
    found = judge(GOOD, None, POOR)
    assert (found.verdict, found.quantity) == ("fails", "home_drop")
    assert found.gap == paired_difference(GOOD, POOR).interval
    assert "10 paired seeds" in found.reason
    assert "at home" in found.reason


def test_transfers() -> None:
    many = [1.0, 0.95, 0.98] * 7
    for native, quantity in ((many, "transfer_gap"), (None, "home_drop")):
        found = judge(many, native, many)
        assert (found.verdict, found.quantity) == ("transfers", quantity)
        assert found.p_equivalent_adjusted is not None
        assert found.p_equivalent_adjusted < 0.05
        assert "±0.1" in found.reason


def test_difficulty_is_removed_by_the_natives() -> None:
    """Losing as much as the policies trained there lose is no failure to transfer."""
    hard = [0.55, 0.65] * 10
    assert judge([1.0] * 20, hard, hard).verdict != "fails"
    assert judge([1.0] * 20, None, hard).verdict == "fails"


def test_inconclusive_between_the_margins() -> None:
    found = judge(GOOD, GOOD, MIDDLE)
    assert found.verdict == "inconclusive"
    assert "neither" in found.reason
    assert found.gap.estimate == pytest.approx(0.175)


def test_inconclusive_when_better_than_at_home() -> None:
    """Equivalence is two-sided: a large gain is neither a failure nor the same."""
    found = judge([0.6] * 10, None, [1.0] * 10)
    assert found.verdict == "inconclusive"
    assert found.gap.estimate == pytest.approx(-0.4)


@pytest.mark.parametrize(
    ("home", "native", "transferred"),
    [
        ([1.0] * 4, [1.0] * 40, [0.0] * 4),
        ([1.0] * 40, [1.0] * 4, [0.0] * 40),
        ([1.0] * 4, None, [0.0] * 4),
    ],
)
def test_inconclusive_with_fewer_than_five_seeds(
    home: list[float], native: list[float] | None, transferred: list[float]
) -> None:
    found = judge(home, native, transferred)
    assert found.p_exceeds_adjusted is not None
    assert found.p_exceeds_adjusted < 0.05
    assert found.verdict == "inconclusive"
    assert "at least 5 needed" in found.reason


def test_five_seeds_are_enough_for_a_clear_failure() -> None:
    assert judge([1.0] * 5, [1.0] * 5, [0.0] * 5).verdict == "fails"


def test_not_learned_gets_a_mark_and_leaves_the_family() -> None:
    family = [
        Comparison("not", [0.5, 0.49] * 5, GOOD, MIDDLE),
        Comparison("learned", GOOD, GOOD, [0.3, 0.7] * 5),
    ]
    not_learned, learned = judge_family(family)
    assert not_learned.verdict == "not_learned"
    assert not_learned.p_exceeds is None
    assert not_learned.p_equivalent_adjusted is None
    assert "0.49" in not_learned.reason
    assert learned.p_exceeds == unpaired_difference(GOOD, [0.3, 0.7] * 5).p_exceeds(0.2)
    assert learned.p_exceeds_adjusted == learned.p_exceeds
    with_both = judge_family([dataclasses.replace(family[0], home=GOOD), family[1]])
    assert with_both[1].p_exceeds_adjusted == pytest.approx(2.0 * learned.p_exceeds)


def test_home_success_of_exactly_one_half_is_learned() -> None:
    assert judge([0.9, 0.1] * 5, None, ZERO).verdict != "not_learned"


def test_natives_that_did_not_learn_are_no_yardstick() -> None:
    """Total failure where nobody learned is judged against home, not called a transfer."""
    many = [1.0] * 40
    found = judge(many, [0.0] * 40, [0.0] * 40)
    assert (found.verdict, found.quantity) == ("fails", "home_drop")
    assert "did not learn (0.00)" in found.reason


def test_each_test_is_corrected_over_the_family() -> None:
    borderline = [0.5, 0.3, 0.75] * 3 + [0.4]
    family = [Comparison(f"c{k}", GOOD, GOOD, borderline) for k in range(6)]
    family.append(Comparison("few", GOOD[:3], None, POOR[:3]))
    alone, found = judge_family(family[:1]), judge_family(family)
    assert alone[0].verdict == "fails"
    assert found[0].verdict == "inconclusive"
    assert [f.name for f in found] == [c.name for c in family]
    exceeds = [f.p_exceeds for f in found if f.p_exceeds is not None]
    equivalent = [f.p_equivalent for f in found if f.p_equivalent is not None]
    assert [f.p_exceeds_adjusted for f in found] == holm(exceeds).tolist()
    assert [f.p_equivalent_adjusted for f in found] == holm(equivalent).tolist()


def test_judgements_are_plain_data() -> None:
    found = dataclasses.asdict(judge(GOOD, GOOD, POOR))
    assert json.loads(json.dumps(found)) == found


def test_empty_family() -> None:
    assert judge_family([]) == ()


@pytest.mark.parametrize(
    ("family", "message"),
    [
        ([Comparison("a", GOOD, None, GOOD)] * 2, "'a' more than once"),
        ([Comparison("a", GOOD, None, GOOD[:-1])], "'a'.*got 10 and 9 seeds"),
        ([Comparison("a", [], None, [])], "at least one training seed"),
        ([Comparison("a", GOOD, [2.0], GOOD)], r"in \[0, 1\], got 2.0"),
    ],
)
def test_bad_family(family: list[Comparison], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        judge_family(family)


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


def test_reference_class_threshold() -> None:
    assert reference_class(0.6, 0.9, threshold=0.7) == "false_fail"


@pytest.mark.parametrize("arguments", [(1.1, 0.5), (0.5, float("nan")), (0.5, 0.5, -0.1)])
def test_reference_class_refuses_what_is_no_rate(arguments: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match=r"in \[0, 1\]"):
        reference_class(*arguments)


# --- compare_policies ----------------------------------------------------------------------


def test_accepted() -> None:
    found = claim(cell("coarse", GOOD, GOOD))
    assert found.outcome == "accepted"
    assert [c.status for c in found.cells] == ["undecided", "win", "win"]
    assert "quarter" in found.reason
    assert "truth" in found.reason


def test_rejected_when_the_sign_reverses_in_a_coarse_cell() -> None:
    found = claim(cell("coarse", POOR, GOOD), cell("half", GOOD, POOR))
    assert found.outcome == "rejected"
    assert [c.status for c in found.cells] == ["reversal", "win", "win", "win"]
    assert "reverses in 1 of 4" in found.reason
    assert "coarse" in found.reason


@pytest.mark.parametrize("where", ["quarter", "reference"])
def test_rejected_when_the_win_is_not_significant_where_it_decides(where: str) -> None:
    rates = {where: (GOOD, GOOD)}
    found = claim(cell("coarse", GOOD, POOR), **rates)
    assert found.outcome == "rejected"
    assert "not significant" in found.reason
    assert ("quarter" if where == "quarter" else "truth") in found.reason


def test_rejected_when_nobody_solves_the_reference() -> None:
    found = claim(cell("coarse", GOOD, POOR), reference=(ZERO, [0.04] * 10))
    assert found.outcome == "rejected"
    assert found.cells[-1].status == "unsolved"
    assert found.cells[-1].p_reversal_adjusted is None
    assert "which nobody solves" in found.reason


def test_cells_nobody_solves_say_nothing() -> None:
    found = claim(cell("coarse", ZERO, [0.04] * 10))
    assert found.outcome == "accepted"
    assert found.cells[0].status == "unsolved"
    assert claim(quarter=(ZERO, ZERO), reference=(ZERO, ZERO)).outcome == "uninformative"


def test_a_cell_only_one_policy_solves_is_informative() -> None:
    found = claim(cell("coarse", ZERO, [0.8] * 10))
    assert found.cells[0].status == "reversal"
    assert found.outcome == "rejected"


def test_too_few_seeds() -> None:
    few = (GOOD[:4], POOR)
    undecided = claim(reference=few)
    assert undecided.outcome == "uninformative"
    assert "Fewer than 5 seeds in truth" in undecided.reason
    assert claim(quarter=few, reference=few).outcome == "uninformative"
    ignored = claim(cell("coarse", POOR[:4], GOOD[:4]))
    assert ignored.cells[0].status == "too_few_seeds"
    assert ignored.outcome == "accepted"


def test_a_reversal_counts_even_where_a_deciding_cell_has_too_few_seeds() -> None:
    found = claim(cell("coarse", POOR, GOOD), reference=(GOOD[:4], POOR[:4]))
    assert found.outcome == "rejected"


def test_reversals_are_corrected_over_the_informative_cells() -> None:
    """One borderline reversal rejects alone, but not as one of many cells looked at."""
    a, b = [0.55, 0.75, 0.5, 0.4, 0.7, 0.6, 0.5, 0.6], [0.9, 0.95, 0.8, 1.0, 0.9, 0.7, 0.8, 0.9]
    p = unpaired_difference(a, b).p_less()
    assert 0.05 / 10 < p < 0.05 / 3
    assert claim(cell("one", a, b)).outcome == "rejected"
    others = [cell(f"other{k}", GOOD, GOOD) for k in range(7)]
    found = claim(cell("one", a, b), *others, *[cell("dead", ZERO, ZERO)])
    assert found.outcome == "accepted"
    assert found.cells[0].p_reversal == p
    assert found.cells[0].p_reversal_adjusted == pytest.approx(10 * p)


def test_findings_are_plain_data() -> None:
    found = dataclasses.asdict(claim(cell("coarse", GOOD, POOR)))
    assert json.loads(json.dumps(found))["cells"][0] == found["cells"][0]


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
