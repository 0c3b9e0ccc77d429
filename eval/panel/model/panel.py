"""A whole panel, as ``panel.json`` holds it."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime
from functools import cached_property
from typing import Any, Final, Literal, NamedTuple

from integ_gym.support.errors import InputError
from integ_gym.support.terminal import fixed, percent

from ...verdict import FAIL_MARGIN, UNSOLVABLE, require_unique
from .conclusions import (
    EngineAgreement,
    Failure,
    PairedEpisodes,
    PolicyComparison,
    RankingAgreement,
    Remedy,
    TrainingCost,
    Verdict,
)
from .matrix import Cell, Entry, Row
from .part import Part

SCHEMA_VERSION: Final = 5
"""Version of ``panel.json`` that is written and read here."""

ROW_ORDER: Final = ("trained", "given", "baseline")
"""Kinds of rows in the order in which they are shown."""

UNSKILLED: Final = ("random", "zero")
"""Baselines that know nothing of a task."""


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
        answer: answer to it, a line for each thing that is said; the first says success at home, on
            the truth, what is lost, and whether dt is the cause.
        warnings: what a reader must know before trusting anything here.
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
        paired: what given policies do in each cell, beside what they do at home or on the truth
            from the same starts.
        verdicts: verdicts on the declared family of transfers.
        looks: every look at the verdicts, the last is this one; empty before the first.
        policy_comparisons: comparisons of declared pairs of rows.
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

    schema_version: Literal[5] = SCHEMA_VERSION
    name: str
    question: str
    answer: str
    warnings: tuple[str, ...] = ()
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
    paired: tuple[PairedEpisodes, ...] = ()
    verdicts: tuple[Verdict, ...] = ()
    looks: tuple[Look, ...] = ()
    policy_comparisons: tuple[PolicyComparison, ...] = ()
    remedies: tuple[Remedy, ...] = ()
    training_costs: dict[str, TrainingCost] = {}  # noqa: RUF012 (msgspec copies it)
    engine_agreement: tuple[EngineAgreement, ...] = ()
    rankings: tuple[RankingAgreement, ...] = ()
    failures: tuple[Failure, ...] = ()
    failures_total: int = 0

    def __post_init__(self) -> None:
        require_unique([row.name for row in self.rows], "row")
        require_unique([cell.name for cell in self.cells], "cell")
        require_unique([f"{e.row} in {e.cell}" for e in self.matrix], "entry")
        for entry in self.matrix:
            if entry.row not in self._row_places or entry.cell not in self._cell_places:
                raise InputError(
                    f"the matrix has {entry.row!r} in {entry.cell!r}, but rows and cells do not "
                    "declare both"
                )

    def row(self, name: str) -> Row:
        """The row of a name."""
        return self.rows[self._row_places[name]]

    def cell(self, name: str) -> Cell:
        """The cell of a name."""
        return self.cells[self._cell_places[name]]

    def entry(self, row: str, cell: str) -> Entry | None:
        """What a row did in a cell, or None where it was not evaluated."""
        return self._entries.get((row, cell))

    def anchor(self, row: str, cell: str) -> str | None:
        """Name of an entry's place in the report; None where there is none."""
        if self.entry(row, cell) is None:
            return None
        return f"r{self._row_places[row]}c{self._cell_places[cell]}"

    @cached_property
    def groups(self) -> tuple[Group, ...]:
        """Columns of the success matrix, the truth first: it is what decides."""
        schemes: dict[str, list[Cell]] = {}
        for cell in self.cells:
            if cell.kind == "grid" and cell.plain and not cell.reference:
                schemes.setdefault(cell.scheme, []).append(cell)
        groups = [Group(name, _coarse_first(cells)) for name, cells in schemes.items()]
        truth = tuple(cell for cell in self.cells if cell.reference)
        return (Group("reference", truth, reference=True), *groups) if truth else tuple(groups)

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

    @property
    def headline(self) -> str:
        """The first line of the answer."""
        return self.answer.partition("\n")[0]

    @cached_property
    def given_alone(self) -> bool:
        """Whether policies were given and none was trained: what is replicated is the start."""
        return all(row.kind != "trained" for row in self.rows)

    @cached_property
    def truth(self) -> Cell | None:
        """The reference cell, or None."""
        return next((cell for cell in self.cells if cell.reference), None)

    @cached_property
    def mixed_periods(self) -> bool:
        """Whether the matrix mixes control periods, so that columns must name theirs."""
        return len({cell.control_period for cell in self.columns}) > 1

    def called(self, name: str) -> str:
        """The name of a row or a cell as people read it, in which the truth is called so."""
        if self.truth is None:
            return name
        return name.replace(self.truth.name, "truth").replace("reference dt=", "truth dt=")

    def said(self, text: str) -> str:
        """A sentence as people read it, in which the truth is called so."""
        truth = self.truth
        if truth is not None:
            text = text.replace(truth.name, "the truth")
            at = f"at dt {truth.dt:.6g} s and control period {truth.control_period:.6g} s"
            text = text.replace(f"{truth.integrator} ({truth.engine}) {at}", "the truth")
        return text

    def on_truth(self, row: str) -> Entry | None:
        """What a row did on the reference, or None."""
        return None if self.truth is None else self.entry(row, self.truth.name)

    @cached_property
    def success_doubt(self) -> str:
        """Why the rule of success looks wrong, in a sentence; empty where nothing speaks for it.

        It looks wrong where a baseline that knows nothing of the task succeeds more than a policy
        and returns less, on the same starts.
        """
        found = []
        for entry in self.matrix:
            if self.row(entry.row).baseline or entry.returns is None:
                continue
            for name in UNSKILLED:
                base = self.entry(name, entry.cell)
                if base is None or base.returns is None:
                    continue
                more = base.success.estimate - entry.success.estimate
                low = entry.returns.low
                least = entry.returns.estimate if low is None else low
                if more > FAIL_MARGIN and base.returns.estimate < least:
                    found.append((more, entry, base))
        if not found:
            return ""
        _, entry, base = max(found, key=lambda one: one[0])
        theirs, own = (
            f"{one.row} succeeds in {percent(one.success.estimate)} of episodes with a mean return "
            f"of {fixed(one.returns.estimate if one.returns else None, 1)}"
            for one in (base, entry)
        )
        return (
            f"The rule of success looks wrong: on {entry.cell}, {theirs}, and {own}. Compare "
            "returns, or say which return is a success (--success-return R, where the task takes "
            "it)."
        )

    @cached_property
    def undeclared(self) -> tuple[Entry, ...]:
        """Transfers that nobody declared, largest overfitting first.

        Rows that did not learn and baselines have nothing to transfer and are left out, and so are
        cells that are known not to be solvable in time.
        """
        declared = {(judged.row, judged.cell) for judged in self.verdicts}
        columns = {cell.name for cell in self.columns if cell.achievability not in UNSOLVABLE}
        found = []
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

    @property
    def exploratory_failures(self) -> int:
        """How many of them lose more by overfitting than verdicts let pass."""
        losses = [entry.overfitting for entry in self.exploratory]
        return sum(loss is not None and loss.estimate > FAIL_MARGIN for loss in losses)

    @cached_property
    def _row_places(self) -> dict[str, int]:
        return {row.name: place for place, row in enumerate(self.rows)}

    @cached_property
    def _cell_places(self) -> dict[str, int]:
        return {cell.name: place for place, cell in enumerate(self.cells)}

    @cached_property
    def _entries(self) -> dict[tuple[str, str], Entry]:
        return {(entry.row, entry.cell): entry for entry in self.matrix}


def _coarse_first(cells: Iterable[Cell]) -> tuple[Cell, ...]:
    return tuple(sorted(cells, key=lambda cell: (-cell.control_period, -cell.dt)))
