"""No combination is lost, and the few that are not slow let all values meet."""

from __future__ import annotations

from itertools import combinations, product

import pytest
from pairing import covering

AXES = ("abcd", "xyz", (1, 2))


def _quick(parameters):
    return [one.values for one in parameters if not one.marks]


@pytest.mark.parametrize("strength", [1, 2, 3])
def test_every_combination_is_there_and_the_quick_ones_let_values_meet(strength):
    made = covering(*AXES, strength=strength)
    assert [one.values for one in made] == list(product(*AXES))
    quick = _quick(made)
    for axes in combinations(range(3), strength):
        met = {tuple(values[k] for k in axes) for values in quick}
        assert met == set(product(*(AXES[k] for k in axes)))
    assert all([mark.name for mark in one.marks] in ([], ["slow"]) for one in made)


def test_the_quick_ones_are_few():
    assert len(_quick(covering(*AXES, strength=1))) == 4
    assert len(_quick(covering(*AXES))) <= 14
    assert covering((), "ab") == []
