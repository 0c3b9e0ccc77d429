"""The level of a test, spent over repeated looks at a run that grows.

How far a run will grow is not known, so there is no information fraction to spend by (Lan and
DeMets 1983). Each look has a share of the level that depends on its number alone, and all shares
add up to 1: by Bonferroni's inequality the chance that any look gives a wrong answer stays below
the level, however the looks depend on each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from .rules import ALPHA, MIN_SEEDS, MIN_SEEDS_EQUIVALENCE

FIRST_SHARE: Final = 0.75
"""Of the level, what the first look has; the second has half of the rest, and so on."""


@dataclass(frozen=True)
class Shares:
    """Shares of the level that one look has, in [0, 1]; 0 where the test is not made.

    Attributes
    ----------
    exceeds
        For "overfitting > 0.2", and for comparisons of two policies.
    equivalent
        For "overfitting within ±0.1".
    """

    exceeds: float
    equivalent: float

    @property
    def levels(self) -> tuple[float, float]:
        """The levels themselves."""
        return ALPHA * self.exceeds, ALPHA * self.equivalent


def share_of_look(number: int) -> float:
    """Share of the level that a look has: 3/4, 1/8, 1/16, …; the first look is number 1."""
    return FIRST_SHARE if number == 1 else (1.0 - FIRST_SHARE) * 0.5 ** (number - 1)


def shares_of(seeds: int, before: Sequence[int] = ()) -> Shares:
    """Shares of a look at so many seeds, after looks at ``before``.

    A look spends nothing on a test that is not made with so few seeds: fewer than 5 for any,
    fewer than 33 for equivalence.
    """

    def share(least: int) -> float:
        made = sum(count >= least for count in before)
        return share_of_look(made + 1) if seeds >= least else 0.0

    return Shares(share(MIN_SEEDS), share(MIN_SEEDS_EQUIVALENCE))


def adjust_for_look(p: float, share: float) -> float:
    """A p-value to be held against the whole level where a look has a share of it."""
    return min(1.0, float(p) / share) if share > 0.0 else 1.0
