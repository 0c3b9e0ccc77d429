"""Does "policy A beats policy B" survive refinement of the step?"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from ..statistics.family import holm
from ..statistics.interval import Interval, RatesLike
from ..statistics.rates import Difference, mean_rate, unpaired_difference
from .looks import FIRST_SHARE, adjust_for_look
from .rules import ALPHA, MIN_SEEDS, UNSOLVED, p_text, require_unique

CellRole: TypeAlias = Literal["quarter_step", "reference"]
"""The cells that decide a comparison of two policies: dt/4, and the reference."""

CellStatus: TypeAlias = Literal["win", "reversal", "undecided", "unsolved", "too_few_seeds"]
"""What one cell says about "A beats B"; the last two are uninformative."""

Outcome: TypeAlias = Literal["accepted", "rejected", "uninformative"]
"""Result of a comparison of two policies."""


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
    p_win_adjusted
        The same for the share of the level that this look has; None if uninformative.
    p_reversal
        P-value for "B is better", not adjusted.
    p_reversal_adjusted
        The same after Holm's procedure over the informative cells and for this look's share; None
        if uninformative.
    """

    name: str
    role: CellRole | None
    status: CellStatus
    difference: Interval
    p_win: float
    p_win_adjusted: float | None
    p_reversal: float
    p_reversal_adjusted: float | None


@dataclass(frozen=True)
class PolicyComparison:
    """Result of `compare_policies`: the outcome, why in one sentence, and every cell."""

    outcome: Outcome
    reason: str
    cells: tuple[CellFinding, ...]


def compare_policies(cells: Sequence[PolicyCell], share: float = FIRST_SHARE) -> PolicyComparison:
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

    P-values are divided by the share of the level that this look has (`Looks`).

    Parameters
    ----------
    cells
        One entry for each discretization, at least one of each deciding role.
    share
        Of the level, what this look has; by default that of a first look.

    Raises
    ------
    ValueError
        If a name occurs twice, no cell is at dt/4 or none is the reference, a group is empty,
        or a rate is not finite or outside [0, 1].
    """
    require_unique([cell.name for cell in cells], "cell")
    for role in ("quarter_step", "reference"):
        if not any(cell.role == role for cell in cells):
            raise ValueError(f"expected a cell with role {role!r}; the claim is decided there")
    findings = _find(cells, share)
    outcome, reason = _decide(findings)
    return PolicyComparison(outcome, reason, findings)


def _find(cells: Sequence[PolicyCell], share: float) -> tuple[CellFinding, ...]:
    differences = [unpaired_difference(cell.rates_a, cell.rates_b) for cell in cells]
    blocked = [_uninformative(cell) for cell in cells]
    informative = [i for i, status in enumerate(blocked) if status is None]
    reversals = holm([differences[i].p_less() for i in informative])
    adjusted = {
        i: (adjust_for_look(differences[i].p_greater(), share), adjust_for_look(p, share))
        for i, p in zip(informative, reversals.tolist(), strict=True)
    }
    return tuple(
        _finding(cell, difference, blocked[i], *adjusted.get(i, (None, None)))
        for i, (cell, difference) in enumerate(zip(cells, differences, strict=True))
    )


def _finding(
    cell: PolicyCell,
    difference: Difference,
    blocked: CellStatus | None,
    p_win_adjusted: float | None,
    p_reversal_adjusted: float | None,
) -> CellFinding:
    status: CellStatus = blocked or "undecided"
    if p_win_adjusted is not None and p_win_adjusted < ALPHA:
        status = "win"
    elif p_reversal_adjusted is not None and p_reversal_adjusted < ALPHA:
        status = "reversal"
    return CellFinding(
        name=cell.name,
        role=cell.role,
        status=status,
        difference=difference.interval,
        p_win=difference.p_greater(),
        p_win_adjusted=p_win_adjusted,
        p_reversal=difference.p_less(),
        p_reversal_adjusted=p_reversal_adjusted,
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
        else f"in {f.name}: A − B is {f.difference}, adjusted {p_text(_adjusted_win(f))}"
        for f in findings
    )


def _adjusted_win(finding: CellFinding) -> float:
    return 1.0 if finding.p_win_adjusted is None else finding.p_win_adjusted


def _adjusted_reversal(finding: CellFinding) -> float:
    return 1.0 if finding.p_reversal_adjusted is None else finding.p_reversal_adjusted
