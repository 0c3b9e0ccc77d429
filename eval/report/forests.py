"""Forests: effects with intervals, one under the other."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final, Literal, TypeAlias

from integ_gym.support.terminal import (
    NONE,
    compact,
    fixed,
    percent,
)

from ..panel.cells import swept_name
from ..panel.result import (
    Cell,
    Entry,
    Estimate,
    PairedEpisodes,
    Panel,
    Remedy,
    RemedyCell,
    Row,
    TrainingCost,
    Verdict,
)
from ..power import WITHOUT_VERDICT
from ..verdict import (
    ALPHA,
    EQUIVALENCE_MARGIN,
    FAIL_MARGIN,
    p_text,
)
from .matrices import (
    RATE_AXIS,
    Axis,
    difference_axis,
    value_axis,
)

Tone: TypeAlias = Literal["fails", "transfers", "inconclusive", "not_learned", "soft", "accent"]
"""Colour of a mark, by its name in :data:`integ_gym.support.figures.PALETTE`."""


@dataclass(frozen=True)
class Mark:
    """An estimate drawn as a dot, with its interval if it has one.

    Attributes:
        value: the estimate.
        tone: its colour.
        filled: a ring where it is not.
        down: place across the line, from -1 at its upper edge to 1 at its lower.
    """

    value: Estimate
    tone: Tone
    filled: bool = True
    down: float = 0.0


@dataclass(frozen=True)
class Line:
    """One line of a forest.

    Attributes:
        row: shown before the cell; empty where the heading names it.
        cell: name of a cell.
        leads_to: row and cell of the entry that tells more.
        marks: later ones are drawn over earlier ones.
        number: the number that matters.
        detail: what else there is to say of it.
        words: all of it in words, for tooltips and screen readers.
        note: small print after the cell.
    """

    row: str
    cell: str
    leads_to: tuple[str, str]
    marks: tuple[Mark, ...]
    number: str
    detail: str
    words: str
    note: str = ""


@dataclass(frozen=True)
class Block:
    """Lines under a heading."""

    title: str
    lines: Sequence[Line]


@dataclass(frozen=True)
class Forest:
    """Blocks of lines on one axis.

    Attributes:
        title: of the figure.
        about: how to read it.
        along: what the axis shows.
        axis: of all lines.
        blocks: in order.
    """

    title: str
    about: str
    along: str
    axis: Axis
    blocks: tuple[Block, ...]


VERDICT_ORDER: Final = ("fails", "transfers", "inconclusive", *WITHOUT_VERDICT)
"""Order in which verdicts are shown."""

SHOWN_GAPS: Final = 30
"""Exploratory gaps that are drawn; all of them are among the records."""


@dataclass(frozen=True)
class Gap:
    """Overfitting with its interval, and where it comes from; no verdict: exploratory."""

    row: str
    cell: str
    value: Estimate
    verdict: Tone | None = None


def ordered_verdicts(panel: Panel) -> tuple[Verdict, ...]:
    """Judgements of the declared family, the ones that matter most first."""

    def order(judged: Verdict) -> tuple[int, float]:
        return VERDICT_ORDER.index(judged.verdict), -judged.overfitting.estimate

    return tuple(sorted(panel.verdicts, key=order))


def declared_gaps(panel: Panel) -> tuple[Gap, ...]:
    """Those of the declared family that have a verdict, largest first."""
    return _largest_first(
        Gap(judged.row, judged.cell, judged.overfitting, judged.verdict)  # type: ignore[arg-type]
        for judged in ordered_verdicts(panel)
        if judged.verdict not in WITHOUT_VERDICT
    )


def exploratory_gaps(panel: Panel) -> tuple[Gap, ...]:
    """Those of the rest of the matrix, largest first."""
    return tuple(
        Gap(entry.row, entry.cell, entry.overfitting)
        for entry in panel.undeclared
        if entry.overfitting is not None
    )


def _largest_first(gaps: Iterable[Gap]) -> tuple[Gap, ...]:
    return tuple(sorted(gaps, key=lambda gap: -gap.value.estimate))


def gap_forest(panel: Panel) -> Forest | None:
    """The declared family, then the largest of the rest; None without any gap."""
    declared, others = declared_gaps(panel), exploratory_gaps(panel)
    shown = (*declared, *others[:SHOWN_GAPS])
    if not shown:
        return None
    more = f", the {SHOWN_GAPS} largest of {len(others)}" if len(others) > SHOWN_GAPS else ""
    found = (("declared family", declared), (f"exploratory{more}", others[:SHOWN_GAPS]))
    return Forest(
        "Overfitting",
        f"loss of success that neither difficulty nor a deadline explains; shaded: "
        f"±{EQUIVALENCE_MARGIN}, dashed: {FAIL_MARGIN}{_level(panel, shown)}",
        "loss of success by overfitting",
        difference_axis((gap.value for gap in shown), margins=True),
        tuple(Block(title, [_line(panel, gap) for gap in gaps]) for title, gaps in found if gaps),
    )


def _level(panel: Panel, gaps: Iterable[Gap]) -> str:
    """What to say of the level that the intervals share; nothing where they have none."""
    levels = {gap.value.level for gap in gaps if gap.value.level is not None}
    level = f"{percent(levels.pop())}, " if len(levels) == 1 else ""
    over = "starts" if panel.given_alone else "seeds"
    return f"; intervals over {over}, {level}not adjusted"


def _line(panel: Panel, gap: Gap) -> Line:
    low, high = gap.value.ends
    details = [f"{fixed(low)} to {fixed(high)}"] if gap.value.bounded else []
    return Line(
        panel.called(gap.row),
        panel.called(gap.cell),
        (gap.row, gap.cell),
        (Mark(gap.value, gap.verdict or "soft", filled=gap.verdict is not None),),
        fixed(gap.value.estimate, 2, True),
        ", ".join(details),
        f"{gap.row} on {gap.cell}: overfitting {gap.value}",
    )


@dataclass(frozen=True)
class Mixture:
    """A mixture held against single discretizations.

    Attributes:
        row: trained on the mixture.
        summary: what came out, in sentences.
        harmful: cells in which a single discretization costs success, the worst first.
        others: the rest, in column order.
    """

    row: Row
    summary: str
    harmful: tuple[Line, ...]
    others: tuple[Line, ...]

    @property
    def members(self) -> str:
        """The discretizations that it was trained on, in words."""
        return ", ".join(self.row.shares)


@dataclass(frozen=True)
class Cost:
    """Training decisions of one row until its training episodes succeeded.

    Attributes:
        row: the row.
        training: what it took.
        truth: what the row does on the reference in the end.
    """

    row: Row
    training: TrainingCost
    truth: Estimate | None

    @property
    def median(self) -> str:
        """The median in words."""
        median = self.training.median
        known = None if median is None else median.estimate
        return "not reached" if known is None else f"{round(known):,}"

    @property
    def interval(self) -> str:
        """The interval in words."""
        median = self.training.median
        if median is None or median.low is None:
            return NONE
        end = "or more" if median.high is None else f"to {round(median.high):,}"
        return f"{round(median.low):,} {end}"


def mixtures_of(panel: Panel) -> tuple[Mixture, ...]:
    """The panel's mixtures, in order."""
    return tuple(_mixture(panel, remedy) for remedy in panel.remedies)


def remedy_forest(panel: Panel) -> Forest | None:
    """Every discretization in which single ones lose, by mixture; None without any."""
    blocks = [
        Block(f"{found.row.name}: {found.members}", found.harmful)
        for found in mixtures_of(panel)
        if found.harmful
    ]
    if not blocks:
        return None
    about = (
        "success; dot: mixture, with its interval; rings: single ones, red where they lose > 0.2"
    )
    return Forest("A remedy: training on a mixture", about, "success", RATE_AXIS, tuple(blocks))


def _mixture(panel: Panel, remedy: Remedy) -> Mixture:
    harmful, others = [], []
    for cell in remedy.cells:
        own = panel.entry(remedy.row, cell.cell)
        found = [panel.entry(single, cell.cell) for single in remedy.singles]
        rivals = sorted((e for e in found if e is not None), key=lambda e: e.success.estimate)
        if own is None:
            continue
        line = _remedy_line(own, rivals, cell)
        if cell.solved and cell.lost and rivals:
            harmful.append((rivals[0].success.estimate, line))
        else:
            others.append(line)
    harmful.sort(key=lambda pair: pair[0])
    row = panel.row(remedy.row)
    return Mixture(row, remedy.summary, tuple(line for _, line in harmful), tuple(others))


def _remedy_line(own: Entry, rivals: list[Entry], cell: RemedyCell) -> Line:
    """A mixture in one cell beside rows of a single discretization, the lowest first."""
    lost = {one.row: one.difference for one in cell.lost}
    words, marks = [f"{own.cell}: {own.row} {own.success}"], []
    for rival in rivals:
        alone = Estimate(rival.success.estimate)
        marks.append(Mark(alone, "fails" if rival.row in lost else "soft", False, -0.35))
        less = f", {own.row} minus it {lost[rival.row]}" if rival.row in lost else ""
        words.append(f"{rival.row} {rival.success}{less}")
    rates = [fixed(rival.success.estimate) for rival in rivals]
    notes = ["trained there"] if cell.member else []
    notes += [] if cell.solved else ["nobody solves it"]
    return Line(
        "",
        own.cell,
        (own.row, own.cell),
        (*marks, Mark(own.success, "accent", down=0.35)),
        fixed(own.success.estimate),
        f"others {rates[0]} to {rates[-1]}" if rates else "no other row learned",
        "; ".join(words),
        ", ".join(notes),
    )


def costs_of(panel: Panel) -> tuple[Cost, ...]:
    """Training cost of every trained row that the panel tells it of."""
    costs = []
    for row in panel.ordered_rows:
        if row.name in panel.training_costs:
            truth = panel.on_truth(row.name)
            success = None if truth is None else truth.success
            costs.append(Cost(row, panel.training_costs[row.name], success))
    return tuple(costs)


_Compared = tuple[PairedEpisodes, Estimate, float]
"""Of one cell: what is held against what, the difference and its adjusted p-value."""


def paired_success(panel: Panel) -> Forest | None:
    """What every given policy loses of its success in each cell; None without any."""
    found = [(one, one.success, one.p_success_adjusted) for one in panel.paired]
    told = partial(fixed, digits=2)
    return _forest(panel, "Success lost", found, difference_axis, told, EQUIVALENCE_MARGIN)


def paired_return(panel: Panel) -> Forest | None:
    """What every given policy loses of its mean return in each cell; None without any."""
    found = [
        (one, one.returns, one.p_return_adjusted)
        for one in panel.paired
        if one.returns is not None and one.p_return_adjusted is not None
    ]
    return _forest(panel, "Mean return lost", found, value_axis, partial(compact, digits=3))


def _forest(
    panel: Panel,
    title: str,
    found: list[_Compared],
    axis: Callable[[Iterable[Estimate]], Axis],
    told: Callable[..., str],
    margin: float | None = None,
) -> Forest | None:
    if not found:
        return None
    blocks: dict[tuple[str, bool], list[_Compared]] = {}
    for compared in found:
        key = (compared[0].row, panel.cell(compared[0].cell).perturbation is not None)
        blocks.setdefault(key, []).append(compared)
    levels = {value.level for _, value, _ in found if value.level is not None}
    level = f"{percent(levels.pop())}, " if len(levels) == 1 else ""
    equal = f"; green: practically equal (within ±{margin})" if margin else ""
    return Forest(
        title,
        f"positive is worse; intervals over starts, {level}not adjusted; p adjusted over the "
        f"cells; filled: below {ALPHA}{equal}",
        title.lower(),
        axis(value for _, value, _ in found),
        tuple(
            Block(
                _heading(block[0][0], perturbed),
                [_paired_line(panel, title, told, margin, *compared) for compared in block],
            )
            for (_, perturbed), block in blocks.items()
        ),
    )


def _heading(one: PairedEpisodes, perturbed: bool) -> str:
    where = "at home" if one.against == "home" else "on the truth"
    what = "perturbations" if perturbed else "discretizations"
    return f"{one.row}, {one.episodes} starts: {what} against what it does {where}"


def _paired_line(
    panel: Panel,
    title: str,
    told: Callable[..., str],
    margin: float | None,
    one: PairedEpisodes,
    value: Estimate,
    p: float,
) -> Line:
    low, high = value.ends
    interval = f"{told(low)} to {told(high)}, " if value.bounded else ""
    number, shown = told(value.estimate, sign=True), p < ALPHA
    equal = margin is not None and value.bounded and -margin <= low and high <= margin
    tone: Tone = "transfers" if equal else "accent" if shown else "soft"
    practically = ", practically equal" if equal else ""
    return Line(
        "",
        panel.called(one.cell),
        (one.row, one.cell),
        (Mark(value, tone, filled=shown),),
        number,
        f"{interval}{p_text(p)}",
        f"{one.row} on {one.cell}: {title.lower()} {number}, {interval}adjusted {p_text(p)}"
        f"{practically}",
    )


@dataclass(frozen=True)
class Check:
    """One row before and after a change of the plant or its delays."""

    before: Entry | None
    after: Entry


def checks_of(panel: Panel) -> Mapping[str, tuple[Check, ...]]:
    """For every perturbation, the rows that met it; those that learned, if any did."""
    learned = [row for row in panel.ordered_rows if row.learned is not False]
    return _checks(panel, learned) or _checks(panel, panel.ordered_rows)


def _checks(panel: Panel, rows: Sequence[Row]) -> Mapping[str, tuple[Check, ...]]:
    checks: dict[str, list[Check]] = {}
    swept = {
        swept_name(sweep["argument"], value)
        for sweep in panel.spec.get("sweeps", ())
        for value in sweep["values"]
    }
    for row in rows:
        for cell in panel.cells:
            after = panel.entry(row.name, cell.name)
            if after is not None and not cell.plain and cell.perturbation not in swept:
                label = cell.perturbation or cell.name
                checks.setdefault(label, []).append(Check(_before(panel, after), after))
    return {label: tuple(found) for label, found in checks.items()}


def _before(panel: Panel, after: Entry) -> Entry | None:
    """The same row and discretization without the perturbation."""
    cell = panel.cell(after.cell)
    same = (other for other in panel.cells if other.plain and alike(other, cell))
    return next((panel.entry(after.row, other.name) for other in same), None)


def check_forest(panel: Panel) -> Forest | None:
    """Success before and after every change of the plant or its delays; None without any."""
    blocks = [
        Block(label, [_check_line(change) for change in found])
        for label, found in checks_of(panel).items()
    ]
    if not blocks:
        return None
    about = "success with its interval over seeds: ring as specified, dot with the change; the loss"
    return Forest("Perturbations and latency", about, "success", RATE_AXIS, tuple(blocks))


def _check_line(check: Check) -> Line:
    after = check.after.success
    before = None if check.before is None else check.before.success
    was, marks = NONE, [Mark(after, "accent", down=0.35)]
    if before is not None:
        was = fixed(before.estimate)
        marks.insert(0, Mark(before, "soft", filled=False, down=-0.35))
    loss = None if before is None else before.estimate - after.estimate
    return Line(
        check.after.row,
        check.after.cell if check.before is None else check.before.cell,
        (check.after.row, check.after.cell),
        tuple(marks),
        fixed(loss, sign=True),
        f"{was} → {fixed(after.estimate)}",
        f"{check.after.row}: success {before or 'not known'} before, {after} on {check.after.cell}",
    )


def alike(one: Cell, other: Cell) -> bool:
    """Whether two cells are of the same discretization."""
    names = (one.engine, one.integrator) == (other.engine, other.integrator)
    return names and close(one.dt, other.dt) and close(one.control_period, other.control_period)


def close(one: float, other: float) -> bool:
    """Whether two times, s, are the same up to rounding."""
    return math.isclose(one, other, rel_tol=1e-9)


@dataclass(frozen=True)
class Trust:
    """How far one discretization agrees with the reference."""

    cell: Cell
    judged: tuple[Entry, ...]

    def of(self, kind: str) -> tuple[Entry, ...]:
        """Entries of one class against the reference."""
        return tuple(entry for entry in self.judged if entry.reference_class == kind)

    @property
    def agreeing(self) -> int:
        """Number of rows that the cell and the reference agree about."""
        return len(self.of("true_pass")) + len(self.of("true_fail"))


def trust_of(panel: Panel) -> tuple[Trust, ...]:
    """Every cell of the matrix that has a class against the reference, in column order."""
    found = []
    for cell in panel.columns:
        if cell.reference:
            continue
        entries = (panel.entry(row.name, cell.name) for row in panel.ordered_rows)
        judged = tuple(e for e in entries if e is not None and e.reference_class)
        if judged:
            found.append(Trust(cell, judged))
    return tuple(found)
