"""Does a policy keep its success in another discretization?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from ..statistics import (
    Difference,
    Interval,
    RatesLike,
    holm,
    mean_rate,
    paired_difference,
    unpaired_difference,
)
from .rules import (
    ALPHA,
    EQUIVALENCE_MARGIN,
    FAIL_MARGIN,
    LEARNED,
    MIN_SEEDS,
    p_text,
    require_unique,
)

Verdict: TypeAlias = Literal["fails", "transfers", "inconclusive", "not_learned"]
"""`not_learned` is the mark of a row without a verdict."""

Quantity: TypeAlias = Literal["transfer_gap", "home_drop"]
"""What was judged: s(j,j) − s(i,j), or s(i,i) − s(i,j)."""


@dataclass(frozen=True)
class Comparison:
    """One transfer to judge: policies trained in discretization i, evaluated in j.

    Attributes
    ----------
    name
        Unique in its family.
    home
        Shape (seeds,): success rate of each training seed at home, s(i,i), in [0, 1].
    native
        Shape (other seeds,): rates of policies trained in j and evaluated there, s(j,j), or
        None where none were trained.
    transferred
        Shape (seeds,): rates in j, s(i,j), of the same policies as ``home``, in the same order.
    """

    name: str
    home: RatesLike
    native: RatesLike | None
    transferred: RatesLike


@dataclass(frozen=True)
class Judgement:
    """Verdict on one comparison.

    Attributes
    ----------
    name
        As in the comparison.
    verdict
        `fails`, `transfers`, `inconclusive` or `not_learned`.
    quantity
        What ``gap`` is: `transfer_gap` or `home_drop`.
    gap
        The loss of success (positive is worse) with its 95 % interval, not adjusted for the
        family.
    p_exceeds, p_equivalent
        P-values for "gap > 0.2" and for "gap within ±0.1"; None for `not_learned`.
    p_exceeds_adjusted, p_equivalent_adjusted
        The same after Holm's procedure over the family; None for `not_learned`.
    reason
        One sentence with the numbers that led to the verdict.
    """

    name: str
    verdict: Verdict
    quantity: Quantity
    gap: Interval
    p_exceeds: float | None
    p_equivalent: float | None
    p_exceeds_adjusted: float | None
    p_equivalent_adjusted: float | None
    reason: str


@dataclass(frozen=True)
class _Measured:
    """A comparison with its difference computed and its yardstick chosen."""

    comparison: Comparison
    quantity: Quantity
    difference: Difference
    home: float
    transferred: float
    native: float | None
    seeds: tuple[int, ...]

    @property
    def learned(self) -> bool:
        return self.home >= LEARNED


def loss_of(comparison: Comparison) -> tuple[Quantity, Interval]:
    """The loss of success that `judge_family` would judge, and which quantity it is.

    Raises
    ------
    ValueError
        If home and transferred rates are not of the same number of policies.
    """
    measured = _measure(comparison)
    return measured.quantity, measured.difference.interval


def judge_family(comparisons: Sequence[Comparison]) -> tuple[Judgement, ...]:
    """Judge a declared family of transfers.

    The transfer gap s(j,j) − s(i,j) is judged where policies trained in j are given and have
    learned there (mean success at least 0.5); otherwise the home drop s(i,i) − s(i,j), because
    a group that never learned is no yardstick: against it a policy that fails completely would
    show no gap. The result says which.

    - `not_learned`: mean home success below 0.5. No test is made, and the comparison does not
      count towards the family.
    - `inconclusive`: a group has fewer than 5 training seeds. It still counts towards the
      family, so that an unfinished panel is never judged more lightly than a finished one.
    - `fails`: "gap > 0.2" has an adjusted p-value below 0.05.
    - `transfers`: "gap within ±0.1" (two one-sided tests) has one below 0.05.
    - `inconclusive`: neither.

    Each of the two tests is corrected over the family by itself: wrong `fails` in the family
    have a chance below 0.05, and so have wrong `transfers`. They are two questions, of which a
    reader acts on one, and no comparison can be given both answers; one correction over all
    the tests would bound both chances together, but at twice the number of tests. As it is, the
    chance of any wrong verdict in the family is below 0.10. All this holds as far as the
    p-values do: `Difference.p_equivalent` names the case in which `transfers` is given too
    easily (about the fewest seeds that allow it, and rare total failures).

    Equivalence is hard to show: seeds that all succeed leave room for a tenth that fail. With
    every rate at 1.0 on both sides, the transfer gap needs 15 seeds a side in a family of one
    and 32 in a family of eight; the home drop needs 10 and 25.

    Parameters
    ----------
    comparisons
        The family. The error rates hold where it was chosen without a look at the results.

    Returns
    -------
    One judgement for each comparison, in order.

    Raises
    ------
    ValueError
        If a name occurs twice, ``home`` and ``transferred`` have different lengths, a group is
        empty, or a rate is not finite or outside [0, 1].
    """
    require_unique([comparison.name for comparison in comparisons], "comparison")
    measured = [_measure(comparison) for comparison in comparisons]
    tested = [m for m in measured if m.learned]
    exceeds = [m.difference.p_exceeds(FAIL_MARGIN) for m in tested]
    equivalent = [m.difference.p_equivalent(EQUIVALENCE_MARGIN) for m in tested]
    columns = (exceeds, equivalent, holm(exceeds).tolist(), holm(equivalent).tolist())
    p_values = zip(*columns, strict=True)
    return tuple(_judge(m, next(p_values)) if m.learned else _not_learned(m) for m in measured)


def _measure(comparison: Comparison) -> _Measured:
    home, transferred = mean_rate(comparison.home), mean_rate(comparison.transferred)
    if len(comparison.home) != len(comparison.transferred):
        raise ValueError(
            f"comparison {comparison.name!r}: expected home and transferred rates of the same "
            f"policies, got {len(comparison.home)} and {len(comparison.transferred)} seeds"
        )
    native = None if comparison.native is None else mean_rate(comparison.native)
    seeds: tuple[int, ...] = (len(comparison.transferred),)
    if comparison.native is not None and native is not None and native >= LEARNED:
        quantity: Quantity = "transfer_gap"
        seeds = (len(comparison.native), *seeds)
        difference = unpaired_difference(comparison.native, comparison.transferred)
    else:
        quantity = "home_drop"
        difference = paired_difference(comparison.home, comparison.transferred)
    return _Measured(comparison, quantity, difference, home, transferred, native, seeds)


def _judge(m: _Measured, p: tuple[float, float, float, float]) -> Judgement:
    _, _, exceeds, equivalent = p
    seeds, change = _seeds(m), _change(m)
    verdict: Verdict = "inconclusive"
    if min(m.seeds) < MIN_SEEDS:
        reason = f"Only {seeds}, at least {MIN_SEEDS} needed: {change}."
    elif exceeds < ALPHA:
        verdict = "fails"
        reason = f"Loses more than {FAIL_MARGIN} (adjusted {p_text(exceeds)}, {seeds}): {change}."
    elif equivalent < ALPHA:
        verdict = "transfers"
        reason = (
            f"Stays within ±{EQUIVALENCE_MARGIN} (adjusted {p_text(equivalent)}, "
            f"{seeds}): {change}."
        )
    else:
        reason = (
            f"Shown neither to lose more than {FAIL_MARGIN} (adjusted {p_text(exceeds)}) nor to "
            f"stay within ±{EQUIVALENCE_MARGIN} (adjusted {p_text(equivalent)}) with "
            f"{seeds}: {change}."
        )
    return Judgement(m.comparison.name, verdict, m.quantity, m.difference.interval, *p, reason)


def _not_learned(m: _Measured) -> Judgement:
    reason = f"Home success {m.home:.2f} is below {LEARNED}, so there is nothing to transfer."
    gap = m.difference.interval
    return Judgement(
        m.comparison.name, "not_learned", m.quantity, gap, None, None, None, None, reason
    )


def _change(m: _Measured) -> str:
    gap = m.difference.interval
    if m.quantity == "transfer_gap":
        return (
            f"success {m.transferred:.2f} against {m.native:.2f} for policies trained there, "
            f"transfer gap {gap}"
        )
    text = f"success {m.transferred:.2f} against {m.home:.2f} at home, home drop {gap}"
    if m.native is None:
        return text
    return f"{text}, as policies trained there did not learn ({m.native:.2f})"


def _seeds(m: _Measured) -> str:
    if m.quantity == "transfer_gap":
        return f"{m.seeds[0]} native and {m.seeds[1]} transferred seeds"
    return f"{m.seeds[0]} paired seeds"
