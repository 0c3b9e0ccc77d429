"""No combination is lost, and the few that are not slow let all values meet."""

from __future__ import annotations

from itertools import combinations, product

import pytest
from pairing import covering

AXES = ("abcd", "xyz", (1, 2))


@pytest.mark.parametrize("strength", [1, 2, 3])
def test_every_combination_is_there_and_the_quick_ones_let_values_meet(strength):
    made = covering(*AXES, strength=strength)
    assert [one.values for one in made] == list(product(*AXES))
    quick = [one.values for one in made if not one.marks]
    for axes in combinations(range(3), strength):
        met = {tuple(values[k] for k in axes) for values in quick}
        assert met == set(product(*(AXES[k] for k in axes)))
    assert len(quick) <= (4, 14, 24)[strength - 1]
    assert all([mark.name for mark in one.marks] in ([], ["slow"]) for one in made)
