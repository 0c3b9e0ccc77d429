"""Does a policy keep its success in another discretization?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from ..statistics.family import holm
from ..statistics.posterior import DRAWS
from ..statistics.rates import mean_rate
from .achievability import Achieved
from .looks import FIRST_LOOK, Looks, adjust_for_look
from .loss import INTERVAL_DRAWS, Loss, Rates, p_overfitting_exceeds, p_overfitting_within, split
from .rules import (
    ALPHA,
    EQUIVALENCE_MARGIN,
    FAIL_MARGIN,
    LEARNED,
    MIN_SEEDS,
    p_text,
    require_unique,
)

Verdict: TypeAlias = Literal[
    "fails", "transfers", "inconclusive", "not_learned", "unachievable", "too_slow", "undecided"
]
"""The last four are marks of comparisons without a verdict: of the row, or of the cell."""

WITHOUT_VERDICT = ("not_learned", "unachievable", "too_slow", "undecided")


@dataclass(frozen=True)
class Comparison:
    """One transfer to judge: policies trained in discretization i, evaluated in j.

    Attributes
    ----------
    name
        Unique in its family.
    rates
        What the loss is made of.
    cell
        Whether j can be solved at all, decided without these policies.
    """

    name: str
    rates: Rates
    cell: Achieved


@dataclass(frozen=True)
class Judgement:
    """Verdict on one comparison.

    Attributes
    ----------
    name
        As in the comparison.
    verdict
        `fails`, `transfers`, `inconclusive`; without a verdict `not_learned`, `unachievable`,
        `too_slow` or `undecided`.
    loss
        The loss of success (positive is worse) and its parts, with 95 % intervals that are not
        adjusted for the family.
    p_exceeds, p_equivalent
        P-values for "overfitting > 0.2" and for "overfitting within ±0.1"; None without a verdict.
    p_exceeds_adjusted, p_equivalent_adjusted
        The same after Holm's procedure over the family and for the share of the level that this
        look has; 1 where the test is not made with so few seeds, None without a verdict.
    reason
        One sentence with the numbers that led to the verdict.
    """

    name: str
    verdict: Verdict
    loss: Loss
    p_exceeds: float | None
    p_equivalent: float | None
    p_exceeds_adjusted: float | None
    p_equivalent_adjusted: float | None
    reason: str


def judge_family(
    comparisons: Sequence[Comparison], looks: Looks = FIRST_LOOK, *, draws: int = DRAWS
) -> tuple[Judgement, ...]:
    """Judge a declared family of transfers by overfitting; see `Loss`.

    - `not_learned`: mean home success below 0.5; `unachievable`, `too_slow`, `undecided`: the
      cell's status. No test is made, and the comparison does not count towards the family, but
      for `undecided`, which policies that are judged in the cell may have been able to change.
    - `inconclusive`: a group has fewer than 5 training seeds. It still counts towards the
      family, so that an unfinished panel is never judged more lightly than a finished one.
    - `fails`: "overfitting > 0.2" has an adjusted p-value below 0.05.
    - `transfers`: "overfitting within ±0.1" (two one-sided tests) has one below 0.05.
    - `inconclusive`: neither.

    Each of the two tests is corrected over the family by itself: wrong `fails` in the family
    have a chance of at most 0.05, and so have wrong `transfers`. They are two questions, of
    which a reader acts on one, and no comparison can be given both answers. The tests hold their
    level for seeds that are all or nothing as for those that are not; docs/reference/panel.md has
    what was simulated.

    Whoever grows a run until it says something looks more than once. Every look has a share of the
    level (`Looks`), by which its p-values are divided after Holm's procedure, so that these
    chances hold for all looks together.

    Equivalence is hard to show: seeds that all succeed leave room for a tenth that fail, and
    0.9**seeds is the chance to see none of these. With every rate at 1.0, a family of one needs
    33 seeds at the first look, one of four 46 and one of six 50; at the only planned look 30, 44
    and 47.

    Parameters
    ----------
    comparisons
        The family. The error rates hold where it was chosen without a look at the results.
    looks
        Earlier looks at its verdicts, and those that were planned.
    draws
        Draws of every test, and of intervals as far as these have as many.

    Returns
    -------
    One judgement for each comparison, in order.

    Raises
    ------
    ValueError
        If a name occurs twice, or as `Rates`.
    """
    require_unique([comparison.name for comparison in comparisons], "comparison")
    marks = [_mark(comparison) for comparison in comparisons]
    tested = [c.rates for c, mark in zip(comparisons, marks, strict=True) if mark is None]
    exceeds = [p_overfitting_exceeds(rates, FAIL_MARGIN, draws=draws) for rates in tested]
    equivalent = [p_overfitting_within(rates, EQUIVALENCE_MARGIN, draws=draws) for rates in tested]
    untold = [1.0 for mark in marks if mark is not None and mark[0] == "undecided"]
    shares = [looks.shares(len(rates.home)) for rates in tested]
    adjusted = [
        [adjust_for_look(p, share) for p, share in zip(holm([*found, *untold]), own, strict=False)]
        for found, own in (
            (exceeds, [one.exceeds for one in shares]),
            (equivalent, [one.equivalent for one in shares]),
        )
    ]
    p_values = zip(exceeds, equivalent, *adjusted, strict=True)
    splits = [split(c.rates, draws=min(draws, INTERVAL_DRAWS)) for c in comparisons]
    return tuple(
        _judge(c, splits[k], next(p_values), looks.min_seeds_equivalence)
        if mark is None
        else _unjudged(c, splits[k], *mark)
        for k, (c, mark) in enumerate(zip(comparisons, marks, strict=True))
    )


def postponed(judgement: Judgement, reason: str) -> Judgement:
    """The same without its verdict, where not all seeds that were declared are there."""
    if judgement.verdict in WITHOUT_VERDICT:
        return judgement
    return Judgement(judgement.name, "inconclusive", judgement.loss, None, None, None, None, reason)


def _mark(comparison: Comparison) -> tuple[Verdict, str] | None:
    """Why there is no verdict; None where there is one."""
    home = mean_rate(comparison.rates.home)
    if home < LEARNED:
        return (
            "not_learned",
            f"Home success {home:.2f} is below {LEARNED}, so there is nothing to transfer.",
        )
    if comparison.cell.status != "achievable":
        return comparison.cell.status, comparison.cell.reason
    return None


def _unjudged(comparison: Comparison, loss: Loss, verdict: Verdict, reason: str) -> Judgement:
    return Judgement(comparison.name, verdict, loss, None, None, None, None, reason)


def _judge(
    comparison: Comparison,
    loss: Loss,
    p: tuple[float, float, float, float],
    min_seeds_equivalence: int,
) -> Judgement:
    _, _, exceeds, equivalent = p
    rates = comparison.rates
    seeds, change = _seeds(rates), _change(rates, loss)
    verdict: Verdict = "inconclusive"
    if min(len(rates.home), len(rates.home if rates.native is None else rates.native)) < MIN_SEEDS:
        reason = f"Only {seeds}, at least {MIN_SEEDS} needed: {change}."
    elif exceeds < ALPHA:
        verdict = "fails"
        reason = (
            f"Overfitting is above {FAIL_MARGIN} (adjusted {p_text(exceeds)}, {seeds}): {change}."
        )
    elif equivalent < ALPHA:
        verdict = "transfers"
        reason = (
            f"Overfitting is within ±{EQUIVALENCE_MARGIN} (adjusted {p_text(equivalent)}, "
            f"{seeds}): {change}."
        )
    else:
        few = len(rates.home) < min_seeds_equivalence
        least = f"at least {min_seeds_equivalence} seeds are needed"
        within = least if few else f"adjusted {p_text(equivalent)}"
        reason = (
            f"Overfitting is shown neither to be above {FAIL_MARGIN} (adjusted {p_text(exceeds)}) "
            f"nor to be within ±{EQUIVALENCE_MARGIN} ({within}) with {seeds}: {change}."
        )
    return Judgement(comparison.name, verdict, loss, *p, reason=reason)


def _change(rates: Rates, loss: Loss) -> str:
    """Loss and parts in words."""
    home, there, later = (mean_rate(own) for own in rates.row)
    return (
        f"success {home:.2f} at home and {there:.2f} there, {later:.2f} within two horizons; "
        f"overfitting {loss.overfitting}, deadline {loss.deadline.estimate:z.2f}, difficulty "
        f"{loss.difficulty.estimate:z.2f}"
    )


def _seeds(rates: Rates) -> str:
    own = f"{len(rates.home)} seeds"
    return own if rates.native is None else f"{own} and {len(rates.native)} native ones"
