"""Summaries of different code, and when they may be combined."""

from __future__ import annotations

import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from integ_gym.eval.atlas.summaries import (
    Agreement,
    Origin,
    Summary,
    _bare,
    check_agree,
    code_version,
    compare,
    note,
    noted_in,
)

ROWS = [
    {
        "home": "rk4 dt=0.05",
        "seed": seed,
        "cell": cell,
        "episodes": 10,
        "successes": 2,
        "policy_hash": b"p",
    }
    for seed in (3, 4)
    for cell in ("rk4 dt=0.05", "reference dt=0.05")
]


def summary(code, rows=ROWS, instruction_sets=()):
    origin = Origin(
        atlas="a", ratio=1.5, limit=0.6, seal="s", weights="w", code=code, versions={},
        specification={}, cost={}, instruction_sets=instruction_sets,
    )  # fmt: skip
    return Summary(origin, pa.Table.from_pylist(rows))


def test_equal_outcomes_agree():
    found = compare("1.5-seed3", summary("one"), summary("two", ROWS[:2]))
    assert found == Agreement(("one", "two"), "1.5-seed3", policies=1, rows=2)


@pytest.mark.parametrize(("key", "value"), [("successes", 1), ("policy_hash", b"q")])
def test_an_outcome_that_differs_is_named(key, value):
    again = [{**ROWS[0], key: value}]
    with pytest.raises(ValueError, match=f"seed 3 of rk4 dt=0.05 .* {key} differ between code one"):
        compare("1.5-seed3", summary("one"), summary("two", again))


def block(change):
    """Rows of 16 seeds on two training grounds; successes as `change` says of (home, seed)."""
    return [
        {**ROWS[0], "home": home, "seed": seed, "successes": 5 + change(home, seed)}
        for home in ("rk4 dt=0.05", "mixture")
        for seed in range(16)
    ]


BEFORE = block(lambda home, seed: 0)


def test_a_block_of_another_processor_agrees_where_it_differs_by_chance():
    after = block(lambda home, seed: (-1) ** seed if home == "mixture" else 0)
    found = compare("b", summary("one", BEFORE), summary("two", after))
    assert found.difference is not None
    mean, low, high = found.difference
    assert mean == pytest.approx(0.0, abs=1e-12)
    assert -0.05 < low < 0.0 < high < 0.05


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda home, seed: 1 + seed % 2 if home == "mixture" else 0, "success of mixture is"),
        (lambda home, seed: 3 * (-1) ** seed, "success may be another"),
    ],
)
def test_a_block_that_differs_by_more_is_refused(change, told):
    with pytest.raises(ValueError, match=told):
        compare("b", summary("one", BEFORE), summary("two", block(change)))


def test_on_the_same_processor_nothing_is_chance():
    after = block(lambda home, seed: (-1) ** seed if home == "mixture" else 0)
    first, second = (summary(code, rows, ("AVX2",)) for code, rows in (("a", BEFORE), ("b", after)))
    with pytest.raises(ValueError, match=r"seed 0 of mixture .* differ between code a and b"):
        compare("b", first, second)


def test_a_policy_that_was_not_there_is_no_agreement():
    with pytest.raises(ValueError, match="seed 9"):
        compare("1.5-seed3", summary("one"), summary("two", [{**ROWS[0], "seed": 9}]))


def test_agreements_are_kept_once(tmp_path):
    first = Agreement(("one", "two"), "b", 1, 2)
    for agreement in (first, Agreement(("two", "three"), "b", 1, 2), first):
        note(agreement, tmp_path)
    assert sorted(one.codes for one in noted_in(tmp_path)) == [("one", "two"), ("two", "three")]


@given(st.lists(st.tuples(st.sampled_from("abcde"), st.sampled_from("abcde")), max_size=8))
def test_only_versions_that_agreements_connect_are_combined(pairs):
    agreements = [Agreement(pair, "b", 1, 1) for pair in pairs]
    groups = {code: {code} for code in "abcde"}
    for first, second in pairs:
        joined = groups[first] | groups[second]
        groups.update(dict.fromkeys(joined, joined))
    if len(groups["a"]) == 5:
        check_agree([summary(code) for code in "abcde"], agreements)
    else:
        with pytest.raises(ValueError, match="never held against each other"):
            check_agree([summary(code) for code in "abcde"], agreements)


def test_code_is_the_same_whatever_its_docstrings_say():
    assert len(code_version()) == 16
    same = '"""A."""\ndef f(x):\n    """B."""\n    return x  # c\n', "def f(x):\n    return x\n"
    assert _bare(same[0]) == _bare(same[1]) != _bare("def f(x):\n    return -x\n")
