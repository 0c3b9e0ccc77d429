"""The level of a test, spent over repeated looks at a run that grows.

Each look has a share of the level, and all shares add up to at most 1: by Bonferroni's inequality
the chance that any look gives a wrong answer stays below the level, however the looks depend on
each other.

- Where looks are planned, each planned look has an equal share, and any other has none.
- Where they are not, how far a run will grow is not known, so there is no information fraction to
  spend by (Lan and DeMets 1983). The first look has 3/4, every later one half of what is left.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from .loss import HOME_SHARE
from .rules import ALPHA, EQUIVALENCE_MARGIN, MIN_SEEDS

FIRST_SHARE: Final = 0.75
"""Of the level, what the first look has where looks are not planned."""


def fewest_for_equivalence(share: float) -> int:
    """Seeds that show one transfer with a share of the level, where all of them always succeed.

    With n such seeds the p-value is 0.9**n / 0.9.
    """
    log_p = math.log(ALPHA * share * HOME_SHARE)
    return math.floor(log_p / math.log1p(-EQUIVALENCE_MARGIN)) + 1


@dataclass(frozen=True)
class Shares:
    """Shares of the level, in [0, 1]; 0 where the test is not made.

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


@dataclass(frozen=True)
class Looks:
    """Looks at the verdicts of a run so far, and those that were planned.

    Attributes
    ----------
    before
        Seeds at every earlier look, in order; of a look at the same policies in another run what
        it spent there.
    planned
        Seeds at the planned looks; empty where none was planned.
    """

    before: tuple[int | Shares, ...] = ()
    planned: tuple[int, ...] = ()

    def then(self, seen: int | Shares) -> Looks:
        """The same after one more look."""
        return Looks((*self.before, seen), self.planned)

    def shares(self, seeds: int) -> Shares:
        """Shares of a look at so many seeds that comes next.

        A look spends nothing on a test that is not made with so few seeds: fewer than 5 for any,
        fewer than `min_seeds_equivalence` for equivalence.
        """
        spent = [0.0, 0.0]
        seen: list[int] = []
        for look in self.before:
            own = look if isinstance(look, Shares) else self._next(look, seen, spent)
            spent = [spent[0] + own.exceeds, spent[1] + own.equivalent]
            seen += [] if isinstance(look, Shares) else [look]
        return self._next(seeds, seen, spent)

    @property
    def min_seeds_equivalence(self) -> int:
        """Seeds below which overfitting is not tested to be small: no look could show it."""
        return fewest_for_equivalence(1.0 if self.planned else FIRST_SHARE)

    def _next(self, seeds: int, seen: Sequence[int], spent: Sequence[float]) -> Shares:
        """Shares of a look, after looks at `seen` in this run, where so much is spent."""

        def share(least: int, used: float) -> float:
            if seeds < least:
                return 0.0
            if not self.planned:
                return share_after(used)
            tested = [count for count in self.planned if count >= least]
            free = seeds in tested and seeds not in seen
            return min(1.0 / len(tested), max(0.0, 1.0 - used)) if free else 0.0

        return Shares(share(MIN_SEEDS, spent[0]), share(self.min_seeds_equivalence, spent[1]))


FIRST_LOOK: Final = Looks()
"""No look came before, and none was planned."""


def share_after(spent: float) -> float:
    """Share of a look that was not planned, where earlier ones spent so much: 3/4, 1/8, 1/16, …"""
    return FIRST_SHARE if spent == 0.0 else max(0.0, 1.0 - spent) / 2.0


def share_of_look(number: int) -> float:
    """The same by the number of the look; the first is number 1."""
    return Looks((MIN_SEEDS,) * (number - 1)).shares(MIN_SEEDS).exceeds


def adjust_for_look(p: float, share: float) -> float:
    """A p-value to be held against the whole level where a look has a share of it."""
    return min(1.0, float(p) / share) if share > 0.0 else 1.0
