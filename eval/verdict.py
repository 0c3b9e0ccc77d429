"""Verdicts: which wins are physics and which are simulator artefacts.

Three questions, each answered by a function that takes success rates per training seed:

- `judge_family`: does a policy keep its success in another discretization?
- `reference_class`: does a discretization's pass or fail agree with the reference?
- `compare_policies`: does "policy A beats policy B" survive refinement of the step?
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from integ_gym.eval.statistics import (
    Difference,
    Interval,
    RatesLike,
    holm,
    mean_rate,
    paired_difference,
    unpaired_difference,
)

Verdict: TypeAlias = Literal["fails", "transfers", "inconclusive", "not_learned"]
"""`not_learned` is the mark of a row without a verdict."""

Quantity: TypeAlias = Literal["transfer_gap", "home_drop"]
"""What was judged: s(j,j) − s(i,j), or s(i,i) − s(i,j)."""

ReferenceClass: TypeAlias = Literal["true_pass", "false_pass", "false_fail", "true_fail"]
"""A cell's pass or fail, and whether the reference agrees (true) or not (false)."""

CellRole: TypeAlias = Literal["quarter_step", "reference"]
"""The cells that decide a comparison of two policies: dt/4, and the reference."""

CellStatus: TypeAlias = Literal["win", "reversal", "undecided", "unsolved", "too_few_seeds"]
"""What one cell says about "A beats B"; the last two are uninformative."""

Outcome: TypeAlias = Literal["accepted", "rejected", "uninformative"]
"""Result of a comparison of two policies."""

FAIL_MARGIN: Final = 0.2
"""A loss of success shown to be larger than this is a failure to transfer."""

EQUIVALENCE_MARGIN: Final = 0.1
"""A change of success shown to be smaller than this, in either direction, is a transfer."""

ALPHA: Final = 0.05
"""Significance level of every test here."""

MIN_SEEDS: Final = 5
"""Training seeds in either group below which nothing is concluded."""

PASS: Final = 0.5
"""Success rate from which on a row passes in a cell."""

LEARNED: Final = 0.5
"""Mean home success below which a policy counts as not learned."""

UNSOLVED: Final = 0.05
"""Mean success below which a policy counts as not solving a cell."""


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
class PolicyCell:
    """Success of two policies in one discretization.

    Attributes
    ----------
    name
        Unique in its comparison.
    rates_a, rates_b
        Shapes (seeds,) and (other seeds,), in [0, 1]: independent groups of training seeds.
    role
        `quarter_step` for a cell at dt/4, `reference` for the reference, None for the rest.
    """

    name: str
    rates_a: RatesLike
    rates_b: RatesLike
    role: CellRole | None = None


@dataclass(frozen=True)
class CellFinding:
    """What one cell says about "A beats B".

    Attributes
    ----------
    name, role
        As in the cell.
    status
        `win` (A better), `reversal` (B better), `undecided`; `unsolved` or `too_few_seeds`
        where the cell is uninformative.
    difference
        Success of A minus success of B, with its 95 % interval.
    p_win
        P-value for "A is better", not adjusted.
    p_reversal
        P-value for "B is better", not adjusted.
    p_reversal_adjusted
        The same after Holm's procedure over the informative cells; None if uninformative.
    """

    name: str
    role: CellRole | None
    status: CellStatus
    difference: Interval
    p_win: float
    p_reversal: float
    p_reversal_adjusted: float | None


@dataclass(frozen=True)
class PolicyComparison:
    """Result of `compare_policies`: the outcome, why in one sentence, and every cell."""

    outcome: Outcome
    reason: str
    cells: tuple[CellFinding, ...]


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
    _require_unique([comparison.name for comparison in comparisons], "comparison")
    measured = [_measure(comparison) for comparison in comparisons]
    tested = [m for m in measured if m.learned]
    exceeds = [m.difference.p_exceeds(FAIL_MARGIN) for m in tested]
    equivalent = [m.difference.p_equivalent(EQUIVALENCE_MARGIN) for m in tested]
    columns = (exceeds, equivalent, holm(exceeds).tolist(), holm(equivalent).tolist())
    p_values = zip(*columns, strict=True)
    return tuple(_judge(m, next(p_values)) if m.learned else _not_learned(m) for m in measured)


def reference_class(s_cell: float, s_reference: float, threshold: float = PASS) -> ReferenceClass:
    """Class of a cell's answer against the reference's.

    Parameters
    ----------
    s_cell, s_reference
        Success rates of the same policies in the cell and on the reference, in [0, 1].
    threshold
        Rate from which on a policy passes.

    Returns
    -------
    `true_pass` and `true_fail` where both agree; `false_pass` where only the cell passes;
    `false_fail` where only the reference does.

    Raises
    ------
    ValueError
        If a rate or the threshold is not in [0, 1].
    """
    for name, value in (
        ("s_cell", s_cell),
        ("s_reference", s_reference),
        ("threshold", threshold),
    ):
        if not 0.0 <= value <= 1.0:
            raise ValueError(f"expected {name} in [0, 1], got {value!r}")
    if s_cell >= threshold:
        return "true_pass" if s_reference >= threshold else "false_pass"
    return "false_fail" if s_reference >= threshold else "true_fail"


def compare_policies(cells: Sequence[PolicyCell]) -> PolicyComparison:
    """Decide whether the claim "policy A beats policy B" survives refinement.

    A cell is uninformative where either policy has fewer than 5 training seeds, or where nobody
    solves it (both mean success rates below 0.05). Rules, the first that fits:

    1. `uninformative`: no cell is informative.
    2. `rejected`: in some informative cell B is significantly better. These tests are corrected
       over the informative cells (Holm), since one of many is enough to reject.
    3. `uninformative`: a deciding cell (dt/4 or reference) has too few seeds.
    4. `rejected`: in some deciding cell A is not significantly better; a deciding cell that
       nobody solves shows no win either. These tests need no correction, since all of them have
       to succeed (intersection-union test, Berger 1982).
    5. `accepted`.

    Parameters
    ----------
    cells
        One entry for each discretization, at least one of each deciding role.

    Raises
    ------
    ValueError
        If a name occurs twice, no cell is at dt/4 or none is the reference, a group is empty,
        or a rate is not finite or outside [0, 1].
    """
    _require_unique([cell.name for cell in cells], "cell")
    for role in ("quarter_step", "reference"):
        if not any(cell.role == role for cell in cells):
            raise ValueError(f"expected a cell with role {role!r}; the claim is decided there")
    findings = _find(cells)
    outcome, reason = _decide(findings)
    return PolicyComparison(outcome, reason, findings)


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


def _find(cells: Sequence[PolicyCell]) -> tuple[CellFinding, ...]:
    differences = [unpaired_difference(cell.rates_a, cell.rates_b) for cell in cells]
    blocked = [_uninformative(cell) for cell in cells]
    informative = [i for i, status in enumerate(blocked) if status is None]
    adjusted = holm([differences[i].p_less() for i in informative]).tolist()
    by_cell = dict(zip(informative, adjusted, strict=True))
    return tuple(
        _finding(cell, difference, blocked[i], by_cell.get(i))
        for i, (cell, difference) in enumerate(zip(cells, differences, strict=True))
    )


def _finding(
    cell: PolicyCell,
    difference: Difference,
    blocked: CellStatus | None,
    p_reversal_adjusted: float | None,
) -> CellFinding:
    p_win, p_reversal = difference.p_greater(), difference.p_less()
    status: CellStatus = blocked or "undecided"
    if blocked is None and p_win < ALPHA:
        status = "win"
    elif p_reversal_adjusted is not None and p_reversal_adjusted < ALPHA:
        status = "reversal"
    return CellFinding(
        cell.name, cell.role, status, difference.interval, p_win, p_reversal, p_reversal_adjusted
    )


def _uninformative(cell: PolicyCell) -> CellStatus | None:
    if min(len(cell.rates_a), len(cell.rates_b)) < MIN_SEEDS:
        return "too_few_seeds"
    if max(mean_rate(cell.rates_a), mean_rate(cell.rates_b)) < UNSOLVED:
        return "unsolved"
    return None


def _decide(findings: Sequence[CellFinding]) -> tuple[Outcome, str]:
    informative = [f for f in findings if f.p_reversal_adjusted is not None]
    if not informative:
        counts = Counter(f.status for f in findings)
        return "uninformative", (
            f"No cell is informative: {counts['unsolved']} solved by nobody (both below "
            f"{UNSOLVED}), {counts['too_few_seeds']} with fewer than {MIN_SEEDS} seeds."
        )
    reversals = [f for f in informative if f.status == "reversal"]
    if reversals:
        f = min(reversals, key=_adjusted_reversal)
        return "rejected", (
            f"The sign reverses in {len(reversals)} of {len(informative)} informative cells, "
            f"most clearly in {f.name}: A − B is {f.difference}, adjusted "
            f"{p_text(_adjusted_reversal(f))}."
        )
    deciding = [f for f in findings if f.role is not None]
    thin = [f.name for f in deciding if f.status == "too_few_seeds"]
    if thin:
        return "uninformative", f"Fewer than {MIN_SEEDS} seeds in {', '.join(thin)}, which decides."
    lost = [f for f in deciding if f.status != "win"]
    if lost:
        return "rejected", f"The win is not significant {_list(lost)}."
    return "accepted", (
        f"A wins {_list(deciding)}, and no sign reverses in {len(informative)} informative cells."
    )


def _list(findings: Sequence[CellFinding]) -> str:
    return "; ".join(
        f"in {f.name}, which nobody solves"
        if f.status == "unsolved"
        else f"in {f.name}: A − B is {f.difference}, {p_text(f.p_win)}"
        for f in findings
    )


def _adjusted_reversal(finding: CellFinding) -> float:
    return 1.0 if finding.p_reversal_adjusted is None else finding.p_reversal_adjusted


def p_text(value: float) -> str:
    """A p-value in words."""
    return f"p = {value:.3f}" if value >= 0.001 else "p < 0.001"


def _require_unique(names: Sequence[str], kind: str) -> None:
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise ValueError(f"expected {kind} names that differ, got {twice[0]!r} more than once")
