"""What a panel concludes from its matrix."""

from __future__ import annotations

from typing import Literal

from ...power import Verdict as Judged
from ...verdict import CellRole, CellStatus, Outcome
from .part import Estimate, Part


class Verdict(Part, frozen=True, kw_only=True):
    """Verdict on one declared transfer; the p-values are null without one.

    Attributes:
        row: name of the row.
        cell: name of the cell that its policies were transferred to.
        name: name of the transfer.
        verdict: `fails`, `transfers`, `inconclusive`; without a verdict `not_learned`, or the
            cell's status.
        total: success at home minus success here; positive is worse. The next three add up to it.
        difficulty: what policies trained here and the hand-made controller do not reach either.
        deadline: what is won back within a second horizon.
        overfitting: the rest, which the verdict is about.
        p_exceeds: p-value for "overfitting > 0.2".
        p_equivalent: p-value for "overfitting within ±0.1".
        p_exceeds_adjusted: p-value for "overfitting > 0.2" after Holm's procedure over the family,
            divided by the share of the level that this look has; 1 where it has none.
        p_equivalent_adjusted: the same for "overfitting within ±0.1".
        reason: why, in one sentence with numbers.
        seeds_wanted: with how many training seeds four in five such panels would decide an
            `inconclusive` one; null where eight times as many would not, or there is no need.
    """

    row: str
    cell: str
    name: str
    verdict: Judged
    total: Estimate
    difficulty: Estimate
    deadline: Estimate
    overfitting: Estimate
    p_exceeds: float | None
    p_equivalent: float | None
    p_exceeds_adjusted: float | None
    p_equivalent_adjusted: float | None
    reason: str
    seeds_wanted: int | None = None


class PairedEpisodes(Part, frozen=True, kw_only=True):
    """One given policy in one cell, held against what it does from the same starts elsewhere.

    Intervals and tests are over its episodes: they are about this policy and starts like these,
    and say nothing about other training seeds.

    Attributes:
        row: name of the row.
        cell: name of the cell.
        against: what it is held against: `home`, or `truth` where its home is unknown.
        scope: what the numbers are about.
        episodes: how many paired starts.
        success: success there minus success here; positive is worse.
        p_success: two-sided p-value for "success differs", exact.
        p_success_adjusted: the same after Holm's procedure over the row's cells, divided by the
            share of the level that this look has.
        returns: mean return there minus that here; positive is worse; null where a return is not
            finite.
        p_return: two-sided p-value for "the mean return differs"; null as the difference.
        p_return_adjusted: the same after Holm's procedure over the row's cells, divided by the
            share of the level that this look has.
    """

    row: str
    cell: str
    against: Literal["home", "truth"]
    scope: Literal["this policy, these starts"] = "this policy, these starts"
    episodes: int
    success: Estimate
    p_success: float
    p_success_adjusted: float
    returns: Estimate | None
    p_return: float | None
    p_return_adjusted: float | None


class CellFinding(Part, frozen=True, kw_only=True):
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
        p_reversal_adjusted: p-value for "B is better" after Holm's procedure, divided likewise;
            null in an uninformative cell.
    """

    name: str
    role: CellRole | None
    status: CellStatus
    difference: Estimate
    p_win: float
    p_win_adjusted: float | None
    p_reversal: float
    p_reversal_adjusted: float | None


class PolicyComparison(Part, frozen=True, kw_only=True):
    """Whether "A beats B" survives refinement.

    Attributes:
        a: name of the row of A.
        b: name of the row of B.
        outcome: `accepted`, `rejected` or `uninformative`.
        reason: why, in one sentence with numbers.
        cells: what each cell says.
    """

    a: str
    b: str
    outcome: Outcome
    reason: str
    cells: tuple[CellFinding, ...]


class RemedyLoss(Part, frozen=True, kw_only=True):
    """A row of a single discretization that loses success in a cell by overfitting.

    Attributes:
        row: name of the row.
        overfitting: see :class:`Verdict`.
        difference: success of the mixture minus its own.
    """

    row: str
    overfitting: Estimate
    difference: Estimate


class RemedyCell(Part, frozen=True, kw_only=True):
    """A mixture in one cell, beside rows of a single discretization.

    Attributes:
        cell: name of the cell.
        member: whether the mixture was trained there.
        solved: whether any row solves the cell.
        overfitting: of the mixture; see :class:`Verdict`.
        lost: rows trained elsewhere whose overfitting is estimated above 0.2.
    """

    cell: str
    member: bool
    solved: bool
    overfitting: Estimate
    lost: tuple[RemedyLoss, ...]


class Remedy(Part, frozen=True, kw_only=True):
    """A mixture held against single discretizations; exploratory.

    Attributes:
        row: name of the mixture's row.
        singles: names of the rows of a single discretization that learned.
        cells: every cell of the grid, and the reference.
        summary: what came out, in sentences with numbers.
    """

    row: str
    singles: tuple[str, ...]
    cells: tuple[RemedyCell, ...]
    summary: str


class Median(Part, frozen=True, kw_only=True):
    """Median over seeds of what may not be reached; null where it is not.

    Attributes:
        estimate: the median; seeds that never got there count as longest.
        low: lower end of its interval.
        high: upper end of its interval.
        level: nominal coverage of the interval, in (0, 1).
    """

    estimate: float | None
    low: float | None
    high: float | None
    level: float


class TrainingCost(Part, frozen=True, kw_only=True):
    """Decisions of training until training episodes succeeded.

    Attributes:
        window: finished training episodes over which success is averaged.
        rate: share of them that must succeed.
        by_seed: decisions of every seed, shape (seeds,); null where it was not reached.
        reached: how many seeds reached it.
        median: median over seeds; null of fewer than two.
    """

    window: int
    rate: float
    by_seed: tuple[float | None, ...]
    reached: int
    median: Median | None


class EngineAgreement(Part, frozen=True, kw_only=True):
    """A cell on a foreign engine beside the native cell of the same map, its twin.

    Attributes:
        cell: name of the cell.
        engine: the simulator.
        integrator: integrator, as the simulator calls it.
        dt: integration step, s.
        control_period: time between two decisions, s.
        map: the one-step map that it applies.
        twin: name of the native cell; null without one.
        episodes: how many episodes in the cell, over all rows.
        success: success rate of these, in [0, 1].
        twin_success: success rate in the twin, in [0, 1]; null without a twin.
        differing: episodes that end otherwise in the twin; null without one.
        largest: largest difference of a row's success; null without a twin.
    """

    cell: str
    engine: str
    integrator: str
    dt: float
    control_period: float
    map: str
    twin: str | None
    episodes: int
    success: float
    twin_success: float | None
    differing: int | None
    largest: float | None


class RankingAgreement(Part, frozen=True, kw_only=True):
    """Whether a cell ranks the trained policies as the truth does; exploratory.

    Attributes:
        cell: name of the cell.
        policies: how many policies of all rows and seeds.
        correlation: Pearson's, of their success here and on the truth; null where either is the
            same for all.
        violation: mean maximum rank violation, in [0, 1]; 0 where both rank alike.
        chosen: row with the highest success here.
        best: row with the highest success on the truth.
        regret: success on the truth that is lost by taking the one for the other.
    """

    cell: str
    policies: int
    correlation: Estimate | None
    violation: Estimate
    chosen: str
    best: str
    regret: float


class Failure(Part, frozen=True, kw_only=True):
    """A failed episode.

    Attributes:
        row: name of the row.
        cell: name of the cell.
        policy: id of the policy.
        episode_index: place among the paired starts.
        record_id: id of its evidence record.
        label: failure label.
        reason: why, in one sentence with numbers.
    """

    row: str
    cell: str
    policy: str
    episode_index: int
    record_id: str
    label: str
    reason: str
