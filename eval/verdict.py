"""Verdicts: what is achievable, what a loss is made of, and which policy is better."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal, TypeAlias

import msgspec
import numpy as np

from integ_gym.support.errors import InputError

from . import statistics as stats

FAIL_MARGIN: Final = 0.2
"""Overfitting shown to be larger than this is a failure to transfer."""

EQUIVALENCE_MARGIN: Final = 0.1
"""Overfitting shown to be smaller than this, in either direction, is a transfer."""

ALPHA: Final = 0.05
"""Significance level of every test here."""

MIN_SEEDS: Final = 5
"""Training seeds in either group below which nothing is concluded."""

PASS: Final = 0.5
"""Success rate from which on a row passes in a cell."""

LEARNED: Final = 0.5
"""Mean home success below which a policy counts as not learned."""

ACHIEVED: Final = 0.5
"""Share of the starts from which success shows that a cell can be solved."""

TAIL: Final = 0.5
"""A seed that loses more success than this is counted beside the mean."""

UNSOLVED: Final = 0.05
"""Mean success below which a policy counts as not solving a cell."""


def p_text(value: float) -> str:
    """A p-value in words."""
    if value < 0.001:
        return "p < 0.001"
    close = abs(value - ALPHA) < 0.1 * ALPHA
    return f"p = {value:.4f}" if close else f"p = {value:.3f}"


def require_unique(names: Sequence[str], kind: str) -> None:
    """Refuse names of which one occurs more than once."""
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise InputError(f"expected {kind} names that differ, got {twice[0]!r} more than once")


ReferenceClass: TypeAlias = Literal["true_pass", "false_pass", "false_fail", "true_fail"]
"""A cell's pass or fail, and whether the reference agrees (true) or not (false)."""


def reference_class(s_cell: float, s_reference: float) -> ReferenceClass:
    """Class of a cell's answer against the reference's.

    Parameters
    ----------
    s_cell, s_reference
        Success rates of the same policies in the cell and on the reference, in [0, 1].

    Returns
    -------
    `true_pass` and `true_fail` where both agree; `false_pass` where only the cell passes;
    `false_fail` where only the reference does.
    """
    if s_cell >= PASS:
        return "true_pass" if s_reference >= PASS else "false_pass"
    return "false_fail" if s_reference >= PASS else "true_fail"


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

    home: stats.RatesLike
    transferred: stats.RatesLike
    recovered: stats.RatesLike
    native: stats.RatesLike | None = None
    handmade: stats.RatesLike | None = None

    def __post_init__(self) -> None:
        counts = [len(self.home), len(self.transferred), len(self.recovered)]
        if len(set(counts)) > 1:
            raise InputError(
                f"expected home, transferred and recovered rates of the same policies, got "
                f"{counts[0]}, {counts[1]} and {counts[2]} seeds"
            )

    @cached_property
    def row(self) -> stats.Floats:
        """Home, transferred and recovered, shape (3, seeds)."""
        named = {"home": self.home, "transferred": self.transferred, "recovered": self.recovered}
        return np.stack([stats.one_dimensional(rates, name) for name, rates in named.items()])

    @cached_property
    def yardsticks(self) -> tuple[tuple[stats.Floats, stats.Stream], ...]:
        """Those that can be solved with, each with its stream of draws."""
        given = (
            ("native", self.native, stats.Stream.SECOND),
            ("handmade", self.handmade, stats.Stream.THIRD),
        )
        return tuple(
            (stats.one_dimensional(rates, name), stream)
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

    total: stats.Estimate
    difficulty: stats.Estimate
    deadline: stats.Estimate
    overfitting: stats.Estimate


def split(rates: Rates, *, draws: int = INTERVAL_DRAWS) -> Loss:
    """The loss and its parts, each with a 95 % interval over seeds and their starts.

    Every seed has starts of its own, so that seeds and starts vary together between the rates;
    the posterior is that of a Dirichlet process, with weights that the quantities of one policy
    share and that natives and a hand-made controller have of their own.
    """
    drawn = _parts(
        stats.joint_means(rates.row, _ROW_PRIOR, _ROW_WEIGHTS, stats.Stream.FIRST, draws=draws).T,
        [
            stats.joint_means(own[None], _YARDSTICK_PRIOR, _YARDSTICK_WEIGHTS, stream, draws=draws)[
                :, 0
            ]
            for own, stream in rates.yardsticks
        ],
    )
    means = np.array([stats.mean_of(quantity) for quantity in rates.row])
    found = _parts(means, [np.asarray(stats.mean_of(own)) for own, _ in rates.yardsticks])
    return Loss(*(stats.equal_tailed(float(x), own) for x, own in zip(found, drawn, strict=True)))


CHECKED_LEVEL: Final = 0.97
"""Of the posterior interval that a check calls its 95 % interval, because it stops by its width:
`benchmarks/check_coverage.py` simulates how often it holds the loss."""


def checked_loss(
    home: stats.RatesLike, away: stats.RatesLike, *, draws: int = stats.DRAWS
) -> stats.Estimate:
    """The loss of success, home − away, of as many seeds as make its interval narrow.

    Args:
        home: success rate of every seed at home, in [0, 1].
        away: the same of the same seeds in another cell.
        draws: from the posterior.
    """
    drawn = stats.paired_posterior(home, away, draws=draws)
    loss = stats.mean_of(np.asarray(home, float)) - stats.mean_of(np.asarray(away, float))
    checked = stats.equal_tailed(loss, drawn, CHECKED_LEVEL)
    return msgspec.structs.replace(checked, level=stats.LEVEL)


def _parts(
    row: stats.Floats, yardsticks: Sequence[stats.Floats]
) -> tuple[stats.Floats, stats.Floats, stats.Floats, stats.Floats]:
    home, transferred, recovered = row
    compared = np.minimum(home, np.maximum.reduce(yardsticks)) if yardsticks else home
    return (
        home - transferred,
        home - compared,
        recovered - transferred,
        compared - recovered,
    )


def p_overfitting_exceeds(
    rates: Rates, margin: float, weight: float = stats.SHOWN, *, draws: int = stats.DRAWS
) -> float:
    """P-value for "overfitting > ``margin``": small when that is shown.

    Both s_i(i) and a(j) must exceed r_i(j) by the margin (an intersection-union test); that the
    higher of two yardsticks does is shown by either, at twice its p-value.
    """
    (home, _, recovered), yardsticks = _against(rates, (0.0, 1.0, 1.0), 0.0, weight, draws)
    above_home = stats.share(home - recovered <= margin)
    above = [stats.share(own - recovered <= margin) for own in yardsticks]
    return max(above_home, min(1.0, len(above) * min(above))) if above else above_home


def p_overfitting_below(rates: Rates, margin: float, *, draws: int = stats.DRAWS) -> float:
    """P-value for "overfitting < ``margin``": small when that is shown.

    That r_i(j) comes near to s_i(i) shows it, and so does that it comes near to every yardstick;
    of the level, nine tenths are the first's and one is the second's.
    """
    (home, _, recovered), yardsticks = _against(rates, (1.0, 0.0, 0.0), 1.0, stats.PROVEN, draws)
    below_home = stats.share(home - recovered >= margin) / HOME_SHARE
    below = [stats.share(own - recovered >= margin) / (1.0 - HOME_SHARE) for own in yardsticks]
    return min(1.0, below_home, max(below, default=1.0))


def p_overfitting_within(rates: Rates, margin: float, *, draws: int = stats.DRAWS) -> float:
    """P-value for "overfitting within ±``margin``": the larger of two one-sided tests'."""
    return max(
        p_overfitting_below(rates, margin, draws=draws),
        p_overfitting_exceeds(rates, -margin, stats.PROVEN, draws=draws),
    )


def _against(
    rates: Rates, row: tuple[float, float, float], yardstick: float, weight: float, draws: int
) -> tuple[stats.Floats, list[stats.Floats]]:
    """Draws of the row's means and of each yardstick's, with what speaks against a claim."""
    return stats.worst_case_means(rates.row, row, weight, stats.Stream.FIRST, draws=draws).T, [
        stats.worst_case_means(own[None], (yardstick,), weight, stream, draws=draws)[:, 0]
        for own, stream in rates.yardsticks
    ]


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
        """Shares of a look, after looks at `seen` in this run, where so much is spent.

        Of one that was not planned: 3/4, 1/8, 1/16, …
        """

        def share(least: int, used: float) -> float:
            if seeds < least:
                return 0.0
            if not self.planned:
                return FIRST_SHARE if used == 0.0 else max(0.0, 1.0 - used) / 2.0
            tested = [count for count in self.planned if count >= least]
            free = seeds in tested and seeds not in seen
            return min(1.0 / len(tested), max(0.0, 1.0 - used)) if free else 0.0

        return Shares(share(MIN_SEEDS, spent[0]), share(self.min_seeds_equivalence, spent[1]))


FIRST_LOOK: Final = Looks()
"""No look came before, and none was planned."""


def share_of_look(number: int) -> float:
    """Share of a look that was not planned, by its number; the first is number 1."""
    return Looks((MIN_SEEDS,) * (number - 1)).shares(MIN_SEEDS).exceeds


def adjust_for_look(p: float, share: float) -> float:
    """A p-value to be held against the whole level where a look has a share of it."""
    return min(1.0, float(p) / share) if share > 0.0 else 1.0


Achievability: TypeAlias = Literal["achievable", "too_slow", "unachievable", "undecided"]
"""Within the horizon; only within two; not within two; not known."""

UNSOLVABLE: Final = ("too_slow", "unachievable")
"""Cells that no policy is blamed for failing in."""


class Attempt(stats.Part, frozen=True):
    """What policies or a hand-made controller reach in a cell.

    Attributes:
        row: name of the policies' row; null: the hand-made controller.
        success: mean success within the horizon, in [0, 1].
        recovered: mean success within one horizon or two, in [0, 1].
    """

    row: str | None
    success: float
    recovered: float


class Search(stats.Part, frozen=True):
    """Whether the goal's energy can be reached, by a search over controls.

    Attributes:
        horizon: time that the search had, s: twice the duration.
        required: energy that the goal takes, J.
        highest: highest energy reached from each start, J.
        method: how it was searched, in a sentence.
    """

    horizon: float
    required: float
    highest: tuple[float, ...]
    method: str

    @property
    def reached(self) -> float:
        """Share of the starts from which the energy was reached."""
        return float(np.mean(np.asarray(self.highest) >= self.required))


class Achieved(stats.Part, frozen=True):
    """Whether a cell can be solved, and what shows it.

    Attributes:
        status: `achievable`, `too_slow` (within two horizons alone), `unachievable` or
            `undecided`.
        best: the attempt that shows it, or that comes nearest; null without one.
        search: the search that rules the goal out; null without one.
    """

    status: Achievability
    best: Attempt | None = None
    search: Search | None = None


def achieved(attempts: Sequence[Attempt], search: Search | None) -> Achieved:
    """Status of a cell for a horizon.

    `achievable` if an attempt of any policy succeeds from at least half of the starts; `too_slow`
    if one does within two horizons alone; `unachievable` if a search does not find the goal's
    energy from more than half of the starts within two horizons; `undecided` otherwise: that no
    policy has learned proves nothing, and neither does an energy that can be reached.
    """
    best = max(attempts, key=lambda one: one.success, default=None)
    if best is not None and best.success >= ACHIEVED:
        return Achieved("achievable", best)
    best = max(attempts, key=lambda one: one.recovered, default=None)
    if best is not None and best.recovered >= ACHIEVED:
        return Achieved("too_slow", best)
    if search is not None and search.reached < 1.0 - ACHIEVED:
        return Achieved("unachievable", search=search)
    return Achieved("undecided", best)


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
    rates_a: stats.RatesLike
    rates_b: stats.RatesLike
    role: CellRole | None = None


class CellFinding(stats.Part, frozen=True, kw_only=True):
    """What one cell says about "A beats B".

    Attributes:
        name: name of the cell.
        role: `quarter_step` or `reference` where the cell decides.
        status: `win`, `reversal`, `undecided`; `unsolved` or `too_few_seeds` where the cell is
            uninformative.
        difference: success of A minus success of B.
        p_win: p-value for "A is better", not adjusted.
        p_win_adjusted: p-value for "A is better", divided by the share of the level that this look
            has; null in an uninformative cell.
        p_reversal: p-value for "B is better", not adjusted.
        p_reversal_adjusted: p-value for "B is better" after Holm's procedure over the informative
            cells, divided likewise; null in an uninformative cell.
    """

    name: str
    role: CellRole | None
    status: CellStatus
    difference: stats.Estimate
    p_win: float
    p_win_adjusted: float | None
    p_reversal: float
    p_reversal_adjusted: float | None

    @property
    def informative(self) -> bool:
        """Whether both policies have seeds enough, and one of them solves the cell."""
        return self.p_reversal_adjusted is not None


class PolicyComparison(stats.Part, frozen=True, kw_only=True):
    """Whether "A beats B" survives refinement.

    Attributes:
        a: name of the row of A.
        b: name of the row of B.
        outcome: `accepted`, `rejected` or `uninformative`.
        cells: what each cell says.
    """

    a: str
    b: str
    outcome: Outcome
    cells: tuple[CellFinding, ...]


def compare_policies(
    cells: Sequence[PolicyCell], share: float = FIRST_SHARE, *, a: str = "A", b: str = "B"
) -> PolicyComparison:
    """Decide whether the claim "policy A beats policy B" survives refinement.

    A cell is uninformative where either policy has fewer than 5 training seeds, or where neither
    solves it (both mean success rates below 0.05). Rules, the first that fits:

    1. `uninformative`: no cell is informative.
    2. `rejected`: in some informative cell B is significantly better. These tests are corrected
       over the informative cells (Holm), since one of many is enough to reject.
    3. `uninformative`: a deciding cell (dt/4 or reference) has too few seeds.
    4. `rejected`: in some deciding cell A is not significantly better; a deciding cell that
       neither solves shows no win. These tests need no correction, since all of them have
       to succeed (intersection-union test, Berger 1982).
    5. `accepted`.

    P-values are divided by the share of the level that this look has (`Looks`).

    Parameters
    ----------
    cells
        One entry for each discretization, at least one of each deciding role.
    share
        Of the level, what this look has; by default that of a first look.
    a, b
        Names of the policies' rows.

    Raises
    ------
    ValueError
        If a name occurs twice, no cell is at dt/4 or none is the reference, a group is empty,
        or a rate is not finite or outside [0, 1].
    """
    require_unique([cell.name for cell in cells], "cell")
    for role in ("quarter_step", "reference"):
        if not any(cell.role == role for cell in cells):
            raise InputError(f"expected a cell with role {role!r}; the claim is decided there")
    differences = [stats.unpaired_difference(cell.rates_a, cell.rates_b) for cell in cells]
    blocked = [uninformative(cell) for cell in cells]
    tested = [own.p_less() for own, why in zip(differences, blocked, strict=True) if why is None]
    reversals = iter(stats.holm(tested).tolist())
    findings = []
    for cell, difference, why in zip(cells, differences, blocked, strict=True):
        status: CellStatus = why or "undecided"
        win, reversal = None, None
        if why is None:
            win = adjust_for_look(difference.p_greater(), share)
            reversal = adjust_for_look(next(reversals), share)
            status = "win" if win < ALPHA else "reversal" if reversal < ALPHA else status
        finding = CellFinding(
            name=cell.name,
            role=cell.role,
            status=status,
            difference=difference.interval,
            p_win=difference.p_greater(),
            p_win_adjusted=win,
            p_reversal=difference.p_less(),
            p_reversal_adjusted=reversal,
        )
        findings.append(finding)
    return PolicyComparison(a=a, b=b, outcome=_outcome(findings), cells=tuple(findings))


def uninformative(cell: PolicyCell) -> Literal["too_few_seeds", "unsolved"] | None:
    """Why a cell says nothing of two policies; None where it may."""
    if min(len(cell.rates_a), len(cell.rates_b)) < MIN_SEEDS:
        return "too_few_seeds"
    if max(stats.mean_rate(cell.rates_a), stats.mean_rate(cell.rates_b)) < UNSOLVED:
        return "unsolved"
    return None


def _outcome(findings: Sequence[CellFinding]) -> Outcome:
    statuses = {f.status for f in findings if f.informative}
    deciding = {f.status for f in findings if f.role is not None}
    if not statuses:
        return "uninformative"
    if "reversal" in statuses:
        return "rejected"
    if "too_few_seeds" in deciding:
        return "uninformative"
    return "accepted" if deciding == {"win"} else "rejected"
