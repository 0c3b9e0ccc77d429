"""A loss of success, split into what the cell, the horizon and overfitting cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from ..statistics.bounds import (
    PROVEN,
    SHOWN,
    share,
    worst_case_means,
)
from ..statistics.interval import (
    Floats,
    Interval,
    RatesLike,
    equal_tailed,
    mean_of,
    one_dimensional,
)
from ..statistics.posterior import DRAWS, joint_means
from ..statistics.streams import Stream

LEVEL: Final = 0.95

INTERVAL_DRAWS: Final = 20_000
"""Draws of an interval: its ends are right to about 0.002."""

_ROW_PRIOR: Final = np.array(
    [
        [1.0, 0.0, 0.0, 1.0, 1.0, 0.0],
        [0.0, 0.0, 1.0, 0.0, 1.0, 0.0],
        [0.0, 1.0, 1.0, 1.0, 1.0, 0.0],
    ]
)
_ROW_WEIGHTS: Final = (0.25, 0.125, 0.125, 0.125, 0.125, 0.25)
"""Pseudo-policies of total weight one: home and recovered have half of it at 0 and half at 1,
their difference a quarter at −1, half at 0 and a quarter at 1, as in `paired_posterior`; a quarter
is won back in the second horizon, which moves total and deadline by as much of their own prior."""

HOME_SHARE: Final = 0.9
"""Of the level at which overfitting is shown to be small, what is spent on home's side."""

_YARDSTICK_PRIOR: Final = np.array([[0.0, 1.0]])
_YARDSTICK_WEIGHTS: Final = (0.5, 0.5)


@dataclass(frozen=True)
class Rates:
    """What a loss is made of: success rates in [0, 1], one per training seed.

    i is where policies were trained, j where they are judged; r counts success within one horizon
    or within two.

    Attributes
    ----------
    home
        Shape (seeds,): s_i(i), at home within the horizon.
    transferred
        Shape (seeds,): s_i(j), of the same policies.
    recovered
        Shape (seeds,): r_i(j), of the same policies.
    native
        Shape (other seeds,): r_j(j) of policies trained in j; None where there are none.
    handmade
        Shape (starts,): r(j) of a hand-made controller, start by start; None without one.

    Raises
    ------
    ValueError
        If the first three differ in length, one is empty, or a rate is outside [0, 1].
    """

    home: RatesLike
    transferred: RatesLike
    recovered: RatesLike
    native: RatesLike | None = None
    handmade: RatesLike | None = None

    def __post_init__(self) -> None:
        counts = [len(self.home), len(self.transferred), len(self.recovered)]
        if len(set(counts)) > 1:
            raise ValueError(
                f"expected home, transferred and recovered rates of the same policies, got "
                f"{counts[0]}, {counts[1]} and {counts[2]} seeds"
            )

    @cached_property
    def row(self) -> Floats:
        """Home, transferred and recovered, shape (3, seeds)."""
        named = {"home": self.home, "transferred": self.transferred, "recovered": self.recovered}
        return np.stack([one_dimensional(rates, name) for name, rates in named.items()])

    @cached_property
    def yardsticks(self) -> tuple[tuple[Floats, Stream], ...]:
        """Those that can be solved with, each with its stream of draws."""
        given = (("native", self.native, Stream.SECOND), ("handmade", self.handmade, Stream.THIRD))
        return tuple(
            (one_dimensional(rates, name), stream)
            for name, rates, stream in given
            if rates is not None
        )


@dataclass(frozen=True)
class Loss:
    """s_i(i) − s_i(j), and its three parts, which add up to it; dimensionless, in [-1, 1].

    With c = min(s_i(i), a(j)), where a(j) is the higher of what natives and a hand-made
    controller reach in j within one or two horizons (s_i(i) where neither is known):

    Attributes
    ----------
    total
        s_i(i) − s_i(j).
    difficulty
        s_i(i) − c: others do not reach there what these policies reach at home.
    deadline
        r_i(j) − s_i(j): what is won back in a second horizon.
    overfitting
        c − r_i(j): the rest, which verdicts are about.
    """

    total: Interval
    difficulty: Interval
    deadline: Interval
    overfitting: Interval


def split(rates: Rates, *, draws: int = INTERVAL_DRAWS) -> Loss:
    """The loss and its parts, each with a 95 % interval over seeds and their starts.

    Every seed has starts of its own, so that seeds and starts vary together between the rates;
    the posterior is that of a Dirichlet process, with weights that the quantities of one policy
    share and that natives and a hand-made controller have of their own.
    """
    drawn = _parts(
        joint_means(rates.row, _ROW_PRIOR, _ROW_WEIGHTS, Stream.FIRST, draws=draws).T,
        [
            joint_means(own[None], _YARDSTICK_PRIOR, _YARDSTICK_WEIGHTS, stream, draws=draws)[:, 0]
            for own, stream in rates.yardsticks
        ],
    )
    means = np.array([mean_of(quantity) for quantity in rates.row])
    found = _parts(means, [np.asarray(mean_of(own)) for own, _ in rates.yardsticks])
    return Loss(*(equal_tailed(float(x), own, LEVEL) for x, own in zip(found, drawn, strict=True)))


def _parts(row: Floats, yardsticks: Sequence[Floats]) -> tuple[Floats, Floats, Floats, Floats]:
    home, transferred, recovered = row
    compared = np.minimum(home, np.maximum.reduce(yardsticks)) if yardsticks else home
    return (
        home - transferred,
        home - compared,
        recovered - transferred,
        compared - recovered,
    )


def p_overfitting_exceeds(
    rates: Rates, margin: float, weight: float = SHOWN, *, draws: int = DRAWS
) -> float:
    """P-value for "overfitting > ``margin``": small when that is shown.

    Both s_i(i) and a(j) must exceed r_i(j) by the margin (an intersection-union test); that the
    higher of two yardsticks does is shown by either, at twice its p-value.
    """
    (home, _, recovered), yardsticks = _against(rates, (0.0, 1.0, 1.0), 0.0, weight, draws)
    above_home = share(home - recovered <= margin)
    above = [share(own - recovered <= margin) for own in yardsticks]
    return max(above_home, min(1.0, len(above) * min(above))) if above else above_home


def p_overfitting_below(rates: Rates, margin: float, *, draws: int = DRAWS) -> float:
    """P-value for "overfitting < ``margin``": small when that is shown.

    That r_i(j) comes near to s_i(i) shows it, and so does that it comes near to every yardstick;
    of the level, nine tenths are the first's and one is the second's.
    """
    (home, _, recovered), yardsticks = _against(rates, (1.0, 0.0, 0.0), 1.0, PROVEN, draws)
    below_home = share(home - recovered >= margin) / HOME_SHARE
    below = [share(own - recovered >= margin) / (1.0 - HOME_SHARE) for own in yardsticks]
    return min(1.0, below_home, max(below, default=1.0))


def p_overfitting_within(rates: Rates, margin: float, *, draws: int = DRAWS) -> float:
    """P-value for "overfitting within ±``margin``": the larger of two one-sided tests'."""
    return max(
        p_overfitting_below(rates, margin, draws=draws),
        p_overfitting_exceeds(rates, -margin, PROVEN, draws=draws),
    )


def _against(
    rates: Rates, row: tuple[float, float, float], yardstick: float, weight: float, draws: int
) -> tuple[Floats, list[Floats]]:
    """Draws of the row's means and of each yardstick's, with what speaks against a claim."""
    return worst_case_means(rates.row, row, weight, Stream.FIRST, draws=draws).T, [
        worst_case_means(own[None], (yardstick,), weight, stream, draws=draws)[:, 0]
        for own, stream in rates.yardsticks
    ]
