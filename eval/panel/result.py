"""The result of a panel: the model of ``panel.json``, read, written and published as a schema."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Iterable, Mapping
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, TypeAlias, get_args

import msgspec

from integ_gym.envs.settings import Discretization
from integ_gym.evidence.schema import published_text, schema_head
from integ_gym.support.errors import InputError
from integ_gym.support.files import read_bounded, write_json

from .. import verdict as rules
from ..contract import Contract
from ..power import Verdict
from ..statistics import Estimate, Median, Part
from .cells import Cell, Home, cell_at, flatten, place_name

RowKind: TypeAlias = Literal["trained", "given", "baseline"]
"""Trained by the panel, given to it, or a baseline without training."""


MOST_CHANGED: Final = rules.EQUIVALENCE_MARGIN
"""Share of episodes that need not converge at a limit; with more, no practical equality could be
shown there."""


class Policy(Part, frozen=True, kw_only=True):
    """One policy of a row.

    Attributes:
        id: name of the policy in the evidence, `policy_id`.
        seed: training seed; null where it is not known.
        hash: hash of the policy's content; null for a baseline of an evaluation.
        file: path of its file beside ``panel.json``; null for a baseline.
    """

    id: str
    seed: int | None = None
    hash: str | None = None
    file: str | None = None


class Row(Part, frozen=True, kw_only=True):
    """Policies of one training discretization or mixture, one for each training seed.

    Attributes:
        name: name of the row, unique.
        kind: `trained`, `given` or `baseline`.
        home: name of the cell that it was trained in; null without one, or of a mixture.
        shares: share of each cell, by name, that its training drew from; empty for a baseline.
        integrator: integrator of its home; null without one, or of a mixture.
        dt: integration step of its home, s; null without one, or of a mixture.
        control_period: time between two decisions in training, s; null for a baseline, and of a
            mixture with several.
        seeds: how many policies it has.
        policies: its policies.
        home_success: success rate at home, in [0, 1]; null without a home.
        learned: whether home success is at least 0.5; null without a home.
        training_steps: decisions that each policy was trained for; null where it was not trained.
    """

    name: str
    kind: RowKind
    home: str | None
    shares: dict[str, float]
    integrator: str | None
    dt: float | None
    control_period: float | None
    seeds: int
    policies: tuple[Policy, ...]
    home_success: Estimate | None = None
    learned: bool | None = None
    training_steps: int | None = None

    @classmethod
    def of(
        cls,
        name: str,
        kind: RowKind,
        policies: Iterable[Policy],
        home: Home | None = None,
        shares: Mapping[str, float] | None = None,
    ) -> Row:
        """A row before anything came out.

        Args:
            name: of the row.
            kind: trained by the panel, given to it, or a baseline.
            policies: one for each training seed.
            home: what they were trained on; None: nothing, or it is not known.
            shares: of the cells that this is; None: they are named as their discretizations.
        """
        alone = home if isinstance(home, Discretization) else None
        known = tuple(policies)
        cells = dict(shares or {})
        if shares is None and home is not None:
            cells = {one.name: share for one, share in home.shares.items()}
        return cls(
            name=name,
            kind=kind,
            home=next(iter(cells)) if alone else None,
            shares=cells,
            integrator=alone.integrator if alone else None,
            dt=alone.dt if alone else None,
            control_period=None if home is None else home.control_period,
            seeds=len(known),
            policies=known,
        )

    @property
    def policy_ids(self) -> tuple[str, ...]:
        """Names of its policies in the evidence."""
        return tuple(policy.id for policy in self.policies)

    @property
    def baseline(self) -> bool:
        """Whether it was not trained."""
        return self.kind == "baseline"

    @property
    def mixed(self) -> bool:
        """Whether it was trained on a mixture of discretizations."""
        return len(self.shares) > 1


class Entry(Part, frozen=True, kw_only=True):
    """What one row did in one cell.

    Attributes:
        row: name of the row.
        cell: name of the cell.
        episodes: how many episodes, over all policies of the row.
        success: success rate, in [0, 1].
        success_by_seed: success rate of each policy, shape (seeds,).
        recovered: success rate within one horizon or two, in [0, 1].
        returns: interquartile mean of the returns, the plain mean where policies were given, as
            published tables have it; null where one of them is not finite; called
            ``return`` in the file.
        time_to_success: time to success, s, of the episodes that succeed; null without one.
        time_to_success_episodes: how many episodes succeed.
        energy_residual: sum of the energy residual over an episode, J; null where not known.
        energy_residual_abs: sum of the residual's sizes, J; null where not known.
        numerics_share: of the energy that successful episodes gain until they first reach the
            goal, the share that numerical error put in; negative where it took some out; null
            where nothing is gained or the residual is not known.
        command_error: root mean square over an episode of what is measured minus what is
            commanded, as a vector, SI units; null where nothing is.
        terminated: episodes that ended before their time, as by a fall; null where a file of
            before does not say it.
        diverged: episodes that the simulation did not survive.
        not_converged: episodes in which the solver missed its tolerance.
        home_drop: success at home minus success here; null at home and without one, and where the
            contract of home is not kept. The next three add up to it.
        difficulty: what policies trained here and the hand-made controller do not reach either.
        deadline: what is won back within a second horizon.
        overfitting: the rest.
        tail: share of the seeds that lose more than 0.5 of success; null at home and without one.
        worst_policy: id of the policy that loses most; null likewise.
        worst_loss: what it loses.
        transfer_gap: success of the policies trained here minus that of these; null without any,
            and where the contract of home is not kept.
        reference_class: the cell's pass or fail beside the reference's; null where the reference
            has another plant or control period, and in cells that cannot be solved in time.
        labels: episodes by failure label; `none` are those that succeed.
        file: evidence files that hold the records, beside ``panel.json``.
        query: command that lists the records.
    """

    row: str
    cell: str
    episodes: int
    success: Estimate
    success_by_seed: tuple[float, ...]
    recovered: Estimate
    returns: Estimate | None = msgspec.field(name="return")
    time_to_success: Estimate | None
    time_to_success_episodes: int
    energy_residual: Estimate | None
    energy_residual_abs: Estimate | None
    numerics_share: Estimate | None = None
    command_error: Estimate | None = None
    terminated: int | None = None
    diverged: int
    not_converged: int
    home_drop: Estimate | None
    difficulty: Estimate | None
    deadline: Estimate | None
    overfitting: Estimate | None
    tail: Estimate | None = None
    worst_policy: str | None = None
    worst_loss: float | None = None
    transfer_gap: Estimate | None
    reference_class: rules.ReferenceClass | None
    labels: dict[str, int]
    file: tuple[str, ...]
    query: str

    @property
    def contradicted(self) -> bool:
        """Whether the reference contradicts its pass or fail."""
        return self.reference_class in ("false_pass", "false_fail")

    def value(self, measure: str) -> float | None:
        """What is reached of a measure, `success` or `return`; None: not known."""
        found = self.success if measure == "success" else self.returns
        return None if found is None else found.estimate


Against: TypeAlias = Literal["home", "truth", "limit"]


class Limit(Part, frozen=True, kw_only=True):
    """What one row reaches at a limit, which stands where there is no truth.

    It is extrapolated from three steps, each half the one before, from the same starts.

    Attributes:
        row: name of the row.
        cell: name of the cell with the finest step, whose entry of the matrix holds what is lost.
        steps: names of the cells, the coarsest first.
        order: of their integrator in the step.
        episodes: how many episodes.
        changed_before: episodes whose success differs in the two coarser steps.
        not_converged: those whose success differs in the two finest steps, or whose return does by
            more than what is called practically equal.
        success: success rate at the finest step; its interval is widened on either side by
            `success_slack`.
        success_slack: share of the episodes whose success differs in the two finest steps.
        returns: mean of the extrapolated returns, of the kind of :class:`Entry`; its interval is
            widened by the mean size of their difference in the two finest steps.
    """

    row: str
    cell: str
    steps: tuple[str, ...]
    order: int
    episodes: int
    changed_before: int
    not_converged: int
    success: Estimate
    success_slack: float
    returns: Estimate | None

    @property
    def converges(self) -> bool:
        """Whether it is called a limit: few episodes do not converge, and not ever more."""
        return self.not_converged <= MOST_CHANGED * self.episodes and not self.grows

    @property
    def grows(self) -> bool:
        """Whether success changes in more episodes, by two standard errors, as the step shrinks."""
        changed = round(self.success_slack * self.episodes)
        both = changed + self.changed_before
        return changed - self.changed_before > 2.0 * math.sqrt(both)


class PairedEpisodes(Part, frozen=True, kw_only=True):
    """One given policy in one cell, held against what it does from the same starts elsewhere.

    Intervals and tests are over its episodes: they are about this policy and starts like these,
    and say nothing about other training seeds.

    Attributes:
        row: name of the row.
        cell: name of the cell.
        against: what it is held against: `home`; where that is unknown, `truth` or else `limit`.
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
    against: Against
    scope: Literal["this policy, these starts"] = "this policy, these starts"
    episodes: int
    success: Estimate
    p_success: float
    p_success_adjusted: float
    returns: Estimate | None
    p_return: float | None
    p_return_adjusted: float | None

    def difference(self, measure: str) -> tuple[Estimate, float] | None:
        """What is lost of `success` or `return`, and its adjusted p-value; None: not known."""
        if measure == "success":
            return self.success, self.p_success_adjusted
        if self.returns is None or self.p_return_adjusted is None:
            return None
        return self.returns, self.p_return_adjusted


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
    """

    row: str
    singles: tuple[str, ...]
    cells: tuple[RemedyCell, ...]


Measure: TypeAlias = Literal["success", "return_per_second"]
"""What a difference costs: success, or the return over the time limit of an episode, 1/s."""

MEASURES: Final[tuple[Measure, ...]] = get_args(Measure)


class AxisCost(Part, frozen=True, kw_only=True):
    """What one of several differences from home costs.

    Attributes:
        axis: `integration`, `held action`, `delay`, `sensing`, `solver`, `version` or `plant`.
        changes: constructor arguments in which the cell differs from home there.
        alone: cell in which nothing else differs from home; null where it cannot be had.
        lost_alone: what is lost there.
        without: cell in which all but this differs from home; null likewise.
        lost_without: what is lost there.
    """

    axis: str
    changes: dict[str, Any]
    alone: str | None
    lost_alone: Estimate | None
    without: str | None
    lost_without: Estimate | None


class Separation(Part, frozen=True, kw_only=True):
    """A cell that differs from a row's home in several ways, and what each of them costs.

    Attributes:
        row: name of the row.
        cell: name of the cell.
        measure: of what is lost: `success`, or `return_per_second`, the return over the time limit
            of an episode, 1/s.
        lost: what is lost in it, against home.
        axes: the ways.
    """

    row: str
    cell: str
    measure: Measure = "success"
    lost: Estimate
    axes: tuple[AxisCost, ...]


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


SCHEMA_VERSION: Final = 7
"""Version of ``panel.json`` that is written and read here."""

ROW_ORDER: Final = ("trained", "given", "baseline")
"""Kinds of rows in the order in which they are shown."""


class Cost(Part, frozen=True, kw_only=True):
    """What a run took, interrupted runs included.

    Attributes:
        wall_seconds: time during which some unit of work was under way, s.
        workers: how many processes worked.
        train_seconds: time of all training runs, added up, s; 0 where policies were given.
        evaluate_seconds: time of all evaluations, added up, s.
    """

    wall_seconds: float
    workers: int
    train_seconds: float
    evaluate_seconds: float


class Look(Part, frozen=True, kw_only=True):
    """A look at the verdicts: what there was, and what it spends of the level of 0.05.

    Attributes:
        seeds: training seeds of the rows that the family names.
        episodes: starts of each.
        natives: declared transfers whose cell had policies trained in it.
        level_exceeds: level of "overfitting > 0.2", and of comparisons of two rows.
        level_equivalent: level of "overfitting within ±0.1".
        adopted: whether it was in another run, whose policies were taken.
    """

    seeds: int
    episodes: int
    natives: int
    level_exceeds: float
    level_equivalent: float
    adopted: bool = False


class Stage(Part, frozen=True, kw_only=True):
    """A panel some of whose training seeds are not here yet.

    Attributes:
        seeds: training seeds that are here.
        of: training seeds of the whole panel.
    """

    seeds: int
    of: int


class Group(NamedTuple):
    """Neighbouring columns: one integrator from its coarsest step to its finest."""

    label: str
    cells: tuple[Cell, ...]
    reference: bool = False


class Panel(Part, frozen=True, kw_only=True, dict=True):
    """Everything that a panel found.

    Attributes:
        schema_version: version of this form.
        name: name of the panel.
        question: question that the panel asks.
        stage: how much of it is here; null where all is.
        doubts: what speaks against trusting its policies or rewards, in sentences.
        spec: specification of the panel.
        protocol_gaps: what of the protocol the panel leaves out, in sentences.
        command: command that makes it again.
        directory: directory in which it was made.
        created: when this was written, UTC.
        platform: operating system and machine on which this was written.
        instruction_sets: of its processor, as numpy names what it uses.
        weights: one hash of all policies' hashes; equal where all weights are; empty without any.
        versions: versions of Python and of all packages that the results depend on.
        cost: time that it took.
        rows: policies, by what they were trained on.
        cells: discretizations in which policies were evaluated.
        matrix: what each row did in each cell that it was evaluated in.
        contracts: homes and cells on other engines, compared before any integration; where they
            differ nothing is judged.
        limits: what rows reach at the limit; empty without one.
        paired: what given policies do in each cell, beside what they do at home or on the truth
            from the same starts.
        verdicts: verdicts on the declared family of transfers.
        looks: every look at the verdicts, the last is this one; empty before the first.
        policy_comparisons: comparisons of declared pairs of rows.
        separations: what each difference costs in cells that differ from home in several.
        units: SI units of the arguments that are varied.
        remedies: mixtures held against single discretizations.
        training_costs: what training cost, by row.
        engine_agreement: cells on foreign engines beside their native twins.
        rankings: whether cells rank the policies as the truth does.
        failures: a sample of the failed episodes of policies that are no baselines.
        failures_total: how many such episodes there are.

    Raises:
        ValueError: if a name occurs twice, or the matrix names a row or cell that the panel does
            not declare.
    """

    schema_version: Literal[7] = SCHEMA_VERSION
    name: str
    question: str
    stage: Stage | None = None
    doubts: tuple[str, ...] = ()
    spec: dict[str, Any]
    protocol_gaps: tuple[str, ...] = ()
    command: str
    directory: str
    created: datetime
    platform: str
    instruction_sets: tuple[str, ...] = ()
    weights: str = ""
    versions: dict[str, str]
    cost: Cost
    rows: tuple[Row, ...]
    cells: tuple[Cell, ...]
    matrix: tuple[Entry, ...]
    contracts: tuple[Contract, ...] = ()
    limits: tuple[Limit, ...] = ()
    paired: tuple[PairedEpisodes, ...] = ()
    verdicts: tuple[Verdict, ...] = ()
    looks: tuple[Look, ...] = ()
    policy_comparisons: tuple[rules.PolicyComparison, ...] = ()
    separations: tuple[Separation, ...] = ()
    units: dict[str, str] = msgspec.field(default_factory=dict)
    remedies: tuple[Remedy, ...] = ()
    training_costs: dict[str, TrainingCost] = msgspec.field(default_factory=dict)
    engine_agreement: tuple[EngineAgreement, ...] = ()
    rankings: tuple[RankingAgreement, ...] = ()
    failures: tuple[Failure, ...] = ()
    failures_total: int = 0

    def __post_init__(self) -> None:
        rules.require_unique([row.name for row in self.rows], "row")
        rules.require_unique([cell.name for cell in self.cells], "cell")
        rules.require_unique([f"{e.row} in {e.cell}" for e in self.matrix], "entry")
        for entry in self.matrix:
            if entry.row not in self.row_places or entry.cell not in self.cell_places:
                raise InputError(
                    f"the matrix has {entry.row!r} in {entry.cell!r}, but rows and cells do not "
                    "declare both"
                )

    def row(self, name: str) -> Row:
        """The row of a name."""
        return self.rows[self.row_places[name]]

    def cell(self, name: str) -> Cell:
        """The cell of a name."""
        return self.cells[self.cell_places[name]]

    def entry(self, row: str, cell: str) -> Entry | None:
        """What a row did in a cell, or None where it was not evaluated."""
        return self._entries.get((row, cell))

    def broken_contract(self, row: str, cell: str) -> Contract | None:
        """How a cell differs from a row's home before any integration; None: it does not.

        Of a mixture, from the first of its members, all of which it must differ from.
        """
        there, shares = self.cell(cell), self.row(row).shares
        if there.packages or not shares or not self.contracts:
            return None
        place = place_name(there.discretization, float(self.spec["control_period"]))
        found = {one.first: one for one in self.contracts if one.second == place}
        contracts = [found.get(home) for home in shares]
        return contracts[0] if all(one is not None and one.broken for one in contracts) else None

    def anchor(self, row: str, cell: str) -> str | None:
        """Name of an entry's place in the report; None where there is none."""
        if self.entry(row, cell) is None:
            return None
        return f"r{self.row_places[row]}c{self.cell_places[cell]}"

    @cached_property
    def groups(self) -> tuple[Group, ...]:
        """Columns of the success matrix, the truth first, then the limit: they are what decides.

        Where it is not called a limit, its finest step is a column like others.
        """
        schemes: dict[str, list[Cell]] = {}
        for cell in self.cells:
            if cell.kind == "grid" and cell.name not in self._limit_names:
                schemes.setdefault(cell.scheme, []).append(cell)
        groups = [Group(name, _coarse_first(cells)) for name, cells in schemes.items()]
        called = self._limit_names
        own = (c for c in self.cells if c.kind == "limit" or c.name in called)
        finest = tuple(cell for cell in own if cell.column)
        truth = tuple(cell for cell in self.cells if cell.reference)
        first = [Group("truth", truth, reference=True)] if truth else []
        if finest:
            first.append(Group("limit" if called else "dt/8", finest, reference=bool(called)))
        return (*first, *groups)

    @cached_property
    def columns(self) -> tuple[Cell, ...]:
        """Cells of the success matrix, in column order."""
        return tuple(cell for group in self.groups for cell in group.cells)

    @cached_property
    def ordered_rows(self) -> tuple[Row, ...]:
        """Trained rows, then given policies, then baselines."""
        return tuple(sorted(self.rows, key=lambda row: ROW_ORDER.index(row.kind)))

    def __repr__(self) -> str:
        """In one line; all of it is in ``panel.json``, and the fields above hold it."""
        about = f"{len(self.rows)} rows, {len(self.cells)} cells"
        return f"<Panel {self.name!r}: {about}; {self.headline}>"

    @cached_property
    def answer(self) -> str:
        """The answer, a line for each thing that is said.

        The first says success at home, on the truth, what is lost, and whether dt is the cause.
        """
        from .conclusions import answer_lines  # which reads panels

        return "\n".join(answer_lines(self))

    @property
    def headline(self) -> str:
        """The first line of the answer."""
        return self.answer.partition("\n")[0]

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What a reader must know before trusting anything here, in sentences."""
        from .conclusions import warning_lines

        return warning_lines(self)

    @cached_property
    def given_alone(self) -> bool:
        """Whether policies were given and none was trained: what is replicated is the start."""
        return all(row.kind != "trained" for row in self.rows)

    @property
    def check(self) -> bool:
        """Whether it is of `integ-gym check`."""
        return bool(self.spec.get("check"))

    @cached_property
    def truth(self) -> Cell | None:
        """The reference cell, or None."""
        return next((cell for cell in self.cells if cell.reference), None)

    @cached_property
    def limit(self) -> Cell | None:
        """The limit's finest step, if it converges for every row but baselines; else None.

        At the first of its control periods.
        """
        return next(map(self.cell, self._limit_names), None)

    @property
    def yardstick(self) -> Cell | None:
        """What cells are held against: the truth, else the limit; None without either."""
        return self.truth or self.limit

    @property
    def yardstick_name(self) -> str:
        """What that is called."""
        return "limit" if self.truth is None and self.limit else "truth"

    @property
    def at_yardstick(self) -> str:
        """Where that is, in a sentence."""
        return f"{'at' if self.yardstick_name == 'limit' else 'on'} the {self.yardstick_name}"

    @cached_property
    def sweeps(self) -> dict[str, dict[float, str]]:
        """Arguments that alone take several values at home or on the truth.

        By argument, the variations' names by value, ascending.
        """
        found: dict[str, dict[float, str]] = {}
        for one in self.spec.get("variations", ()):
            (name, value), *others = flatten(one["changes"])
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if number and not others and {"home", "truth"}.issuperset(map(str, one["at"])):
                found.setdefault(name, {})[float(value)] = one["name"]
        return {name: dict(sorted(own.items())) for name, own in found.items() if len(own) > 1}

    @cached_property
    def mixed_periods(self) -> bool:
        """Whether the matrix mixes control periods, so that columns must name theirs."""
        return len({cell.control_period for cell in self.columns}) > 1

    def label(self, name: str, truth: str = "truth") -> str:
        """The name of a row or a cell as people read it: the reference is the truth.

        Args:
            name: of the row or the cell; another text comes back as it is.
            truth: what the truth is called; a limit is called likewise.
        """
        if name in self._limit_names:
            return truth.replace("truth", self._limit_names[name])
        if self.truth is None:
            return name
        known: tuple[Cell | Row, ...] = (*self.cells, *self.rows)
        one = next((x for x in known if x.name == name), None)
        if one is None or one.integrator != self.truth.integrator:
            return name
        exact = self.truth.name if name.startswith(self.truth.name) else self.truth.scheme
        return truth + name.removeprefix(exact)

    def in_words(self, name: str) -> str:
        """The name of a row or a cell in a sentence."""
        return self.label(name, "the truth")

    def truth_at(self, control_period: float | None) -> Cell | None:
        """The truth at a control period, s; at the panel's where that is not known."""
        if control_period is None:
            return self.truth
        return cell_at((cell for cell in self.cells if cell.reference), control_period)

    def on_yardstick(self, row: str) -> Entry | None:
        """What a row did on the truth, or without one at the limit, at its control period."""
        period = self.row(row).control_period
        found = self.truth_at(period) if self.truth else self.limit_at(period)
        return None if found is None else self.entry(row, found.name)

    def limit_at(self, control_period: float | None) -> Cell | None:
        """The limit at a control period, s; the first where that is not known; None without it."""
        if control_period is None:
            return self.limit
        return cell_at(map(self.cell, self._limit_names), control_period)

    @cached_property
    def undeclared(self) -> tuple[Entry, ...]:
        """Transfers that were not declared, largest overfitting first.

        Rows that did not learn and baselines have nothing to transfer and are left out, and so are
        cells that are known not to be solvable in time.
        """
        declared = {(judged.row, judged.cell) for judged in self.verdicts}
        columns = {cell.name for cell in self.columns if cell.achievability not in rules.UNSOLVABLE}
        found = []  # without those where the contract is not kept, which have no loss
        for entry in self.matrix:
            row = self.row(entry.row)
            if row.baseline or row.learned is False or entry.cell in row.shares:
                continue
            if entry.cell in columns and (entry.row, entry.cell) not in declared:
                found += [(entry.overfitting.estimate, entry)] if entry.overfitting else []
        return tuple(entry for _, entry in sorted(found, key=lambda one: -one[0]))

    @cached_property
    def exploratory(self) -> tuple[Entry, ...]:
        """Those of them in cells that are known to be solvable in time, or were not asked of."""
        return tuple(
            entry for entry in self.undeclared if self.cell(entry.cell).achievability != "undecided"
        )

    @cached_property
    def _limit_names(self) -> dict[str, str]:
        """What limits' finest cells are called; all but the first with the control period."""
        cells = [self.cell(name) for name in limits_called(self.limits, self.rows)]
        others = {cell.name: f"limit control={cell.control_period:g}" for cell in cells[1:]}
        return {cell.name: "limit" for cell in cells[:1]} | others

    @cached_property
    def row_places(self) -> dict[str, int]:
        """Places of rows, by name."""
        return {row.name: place for place, row in enumerate(self.rows)}

    @cached_property
    def cell_places(self) -> dict[str, int]:
        """Places of cells, by name."""
        return {cell.name: place for place, cell in enumerate(self.cells)}

    @cached_property
    def _entries(self) -> dict[tuple[str, str], Entry]:
        return {(entry.row, entry.cell): entry for entry in self.matrix}


def limits_called(limits: Iterable[Limit], rows: Iterable[Row]) -> tuple[str, ...]:
    """Names of the limits' finest cells, where all rows converge but baselines; else none."""
    judged = {row.name for row in rows if not row.baseline}
    own = [one for one in limits if one.row in judged]
    return tuple(dict.fromkeys(x.cell for x in own)) if all(x.converges for x in own) else ()


def _coarse_first(cells: Iterable[Cell]) -> tuple[Cell, ...]:
    return tuple(sorted(cells, key=lambda cell: (-cell.control_period, -cell.dt)))


FILE_NAME: Final = "panel.json"
"""Name of the file in a panel's directory."""

LARGEST = 256 << 20
"""Bytes of it, at most."""


class OtherVersionError(InputError):
    """A ``panel.json`` of another schema version."""


class _Version(msgspec.Struct):
    schema_version: Any = None


def write_panel(panel: Panel, directory: Path) -> Path:
    """Write ``panel.json`` into a panel's directory, whole or not at all.

    Raises:
        ValueError: if a number is not finite.
    """
    path = directory / FILE_NAME
    write_json(path, msgspec.to_builtins(panel))
    return path


def read_panel(path: Path) -> Panel:
    """Read a ``panel.json``.

    Raises:
        ValueError: in one sentence with the remedy, if the file is not JSON, is of another schema
            version, lacks something or contradicts itself.
    """
    try:
        content = read_bounded(path, LARGEST)
        version = msgspec.json.decode(content, type=_Version).schema_version
        if version == SCHEMA_VERSION:
            return msgspec.json.decode(content, type=Panel)
    except (msgspec.DecodeError, RecursionError, ValueError) as error:
        raise InputError(
            f"{path} is damaged or holds no panel ({error}); run the panel again to write it anew"
        ) from error
    raise OtherVersionError(
        f"{path} has schema_version {version!r}, and this version of integ-gym reads "
        f"{SCHEMA_VERSION}; use the version that wrote it, or judge its policies anew with "
        "--policies and another --out; `integ-gym evidence verify` checks its records"
    )


SCHEMA_PATH = Path(__file__).with_name("panel.schema.json")


def json_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of ``panel.json``; every property is described with its unit."""
    (whole,), parts = msgspec.json.schema_components([Panel], ref_template="#/$defs/{name}")
    for part in parts.values():
        _describe(part)
    return {
        **schema_head(f"integ-gym panel, version {SCHEMA_VERSION}"),
        **whole,
        "$defs": parts,
    }


def _describe(part: dict[str, Any]) -> None:
    """Give the attributes that a docstring lists to the properties; a file holds all of them."""
    about, _, rest = inspect.cleandoc(part["description"]).partition("\n\nAttributes:\n")
    attributes = inspect.cleandoc(rest.partition("\n\n")[0])
    found = re.findall(r"^(\w+): (.*(?:\n .*)*)", attributes, re.MULTILINE)
    meanings = {name: " ".join(text.split()) for name, text in found}
    meanings |= {"return": meanings.get("returns", "")}
    part["description"] = " ".join(about.split())
    part["required"] = list(part["properties"])
    for name, kind in part["properties"].items():
        kind.pop("default", None)
        kind["description"] = meanings[name]


def schema_text() -> str:
    """The content of the published file."""
    return published_text(json_schema())


def write_schema() -> None:
    """Write the published file."""
    SCHEMA_PATH.write_text(schema_text(), encoding="utf-8")
