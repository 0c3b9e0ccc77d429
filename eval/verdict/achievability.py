"""Can the task be done in a cell at all, and in time?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

import numpy as np

from integ_gym.support.terminal import percent

from .rules import ACHIEVED

Achievability: TypeAlias = Literal["achievable", "too_slow", "unachievable", "undecided"]
"""Within the horizon; only within two; not within two; not known."""

UNSOLVABLE: Final = ("too_slow", "unachievable")
"""Cells that no policy is blamed for failing in."""


@dataclass(frozen=True)
class Attempt:
    """What somebody reaches in a cell.

    Attributes
    ----------
    name
        Who it is, in words.
    success
        Mean success within the horizon, in [0, 1].
    recovered
        Mean success within one horizon or two.
    """

    name: str
    success: float
    recovered: float


@dataclass(frozen=True)
class Search:
    """Whether the goal's energy can be reached, by a search over controls.

    Attributes
    ----------
    horizon
        Time that the search had, s: twice the duration.
    required
        Energy that the goal takes, J.
    highest
        Highest energy reached from each start, J.
    method
        How it was searched, in a sentence.
    """

    horizon: float
    required: float
    highest: Sequence[float]
    method: str

    @property
    def reached(self) -> float:
        """Share of the starts from which the energy was reached."""
        return float(np.mean(np.asarray(self.highest) >= self.required))


@dataclass(frozen=True)
class Achieved:
    """Status of a cell.

    Attributes
    ----------
    status
        `achievable`, `too_slow`, `unachievable` or `undecided`.
    reason
        One sentence with numbers.
    """

    status: Achievability
    reason: str


def achieved(attempts: Sequence[Attempt], search: Search | None) -> Achieved:
    """Status of a cell for a horizon.

    `achievable` if an attempt succeeds from at least half of the starts, whoever makes it: what was
    done can be done; `too_slow` if one does within two horizons alone; `unachievable` if a search
    does not find the goal's energy from more than half of the starts within two horizons;
    `undecided` otherwise: that nobody has learned proves nothing, and neither does an energy that
    can be reached.
    """
    best = max(attempts, key=lambda one: one.success, default=None)
    if best is not None and best.success >= ACHIEVED:
        return Achieved("achievable", _done(best, best.success, "within the horizon"))
    best = max(attempts, key=lambda one: one.recovered, default=None)
    if best is not None and best.recovered >= ACHIEVED:
        return Achieved("too_slow", _done(best, best.recovered, "within two horizons alone"))
    if search is not None and search.reached < 1.0 - ACHIEVED:
        return Achieved("unachievable", _lost(search))
    most = "nobody tried" if best is None else f"at most {percent(best.recovered)}, by {best.name}"
    return Achieved(
        "undecided", f"Success within two horizons: {most}; no search rules the goal out."
    )


def _done(attempt: Attempt, rate: float, time: str) -> str:
    return f"{attempt.name}: success from {percent(rate)} of the starts {time}."


def _lost(search: Search) -> str:
    return (
        f"A search over controls reaches the goal's energy of {search.required:.3g} J from "
        f"{percent(search.reached)} of the starts within {search.horizon:g} s (at most "
        f"{max(search.highest):.3g} J)."
    )
