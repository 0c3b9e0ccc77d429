"""Forests: effects with intervals, one under the other, on one axis."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final, Literal, TypeAlias

from integ_gym.support.terminal import NONE, compact, fixed, percent

from ..panel.cells import Cell
from ..panel.conclusions import UNSKILLED, remedy_summary
from ..panel.result import Entry, Panel, Remedy, RemedyCell, Row
from ..power import WITHOUT_VERDICT, Verdict
from ..statistics import Estimate
from ..verdict import ALPHA, EQUIVALENCE_MARGIN, FAIL_MARGIN, p_text

Tone: TypeAlias = Literal["fails", "transfers", "inconclusive", "not_learned", "soft", "accent"]
"""Colour of a mark, by its name in :data:`integ_gym.support.figures.PALETTE`."""

SHOWN_GAPS: Final = 30
"""Exploratory gaps that are drawn; all of them are among the records."""

VERDICT_ORDER: Final = ("fails", "transfers", "inconclusive", *WITHOUT_VERDICT)
"""Order in which verdicts are shown."""

_FEW: Final = 5
"""Ticks that a narrow axis has room for."""


@dataclass(frozen=True)
class Axis:
    """A horizontal axis.

    Attributes:
        low, high: its ends.
        ticks: values, and how they are written.
        margins: whether the margins of the verdicts are drawn.
    """

    low: float
    high: float
    ticks: tuple[tuple[float, str], ...]
    margins: bool = False

    @property
    def between(self) -> frozenset[int]:
        """Places of ticks that are left out where an axis is narrow; zero stays."""
        zero = min(range(len(self.ticks)), key=lambda k: abs(self.ticks[k][0]))
        few = len(self.ticks) <= _FEW
        return frozenset() if few else frozenset(range(1 - zero % 2, len(self.ticks), 2))

    def share(self, value: float) -> float:
        """Place of a value, cut to the axis, in [0, 1] of the width with room for markers."""
        inside = (min(max(value, self.low), self.high) - self.low) / (self.high - self.low)
        return 0.02 + 0.96 * inside


RATE_AXIS: Final = Axis(0.0, 1.0, tuple((0.25 * k, fixed(0.25 * k)) for k in range(5)))
"""Axis of success rates."""


def difference_axis(values: Iterable[Estimate], size: float = 0.2, margins: bool = False) -> Axis:
    """An axis for differences of rates that holds all of them and the margins of the verdicts."""
    ends = [end for value in values for end in (value.estimate, *value.ends)]
    low = max(-1.0, math.floor(min([-0.2, *ends]) * 5.0 + 1e-9) / 5.0)
    high = min(1.0, math.ceil(max([0.4, *ends]) * 5.0 - 1e-9) / 5.0)
    size = size if high - low <= 1.6 else 0.5
    places = range(math.ceil(low / size - 1e-9), math.floor(high / size + 1e-9) + 1)
    ticks = [round(size * k, 2) for k in places]
    return Axis(low, high, tuple((tick, fixed(tick, 1)) for tick in ticks), margins)


def value_axis(values: Iterable[Estimate]) -> Axis:
    """An axis for differences of any unit that holds all of them and zero, with five ticks or so.

    Its ticks are multiples of 1, 2 or 5 times a power of ten.
    """
    ends = [end for value in values for end in (value.estimate, *value.ends)]
    low, high = min([0.0, *ends]), max([0.0, *ends])
    wanted = (high - low) / 5.0 or 1.0
    power = 10.0 ** math.floor(math.log10(wanted))
    size = next(power * step for step in (1.0, 2.0, 5.0, 10.0) if power * step >= wanted - 1e-12)
    first, last = min(math.floor(low / size), -1), max(math.ceil(high / size), 1)
    digits = max(0, -math.floor(math.log10(size)))
    ticks = tuple((size * k, fixed(size * k, digits)) for k in range(first, last + 1))
    return Axis(size * first, size * last, ticks)


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


def ordered_verdicts(panel: Panel) -> list[Verdict]:
    """Verdicts on the declared family, the ones that matter most first."""
    return sorted(
        panel.verdicts,
        key=lambda one: (VERDICT_ORDER.index(one.verdict), -one.overfitting.estimate),
    )


def gap_forest(panel: Panel) -> Forest | None:
    """Overfitting of the declared family, then the largest of the rest; None without any."""
    judged = [one for one in ordered_verdicts(panel) if one.verdict not in WITHOUT_VERDICT]
    judged.sort(key=lambda one: -one.overfitting.estimate)
    others = panel.undeclared
    more = f", the {SHOWN_GAPS} largest of {len(others)}" if len(others) > SHOWN_GAPS else ""
    blocks = (
        Block(
            "declared family",
            [_gap_line(panel, one.row, one.cell, one.overfitting, one.verdict) for one in judged],  # type: ignore[arg-type]
        ),
        Block(
            f"exploratory{more}",
            [
                _gap_line(panel, entry.row, entry.cell, entry.overfitting)
                for entry in others[:SHOWN_GAPS]
                if entry.overfitting is not None
            ],
        ),
    )
    values = [line.marks[0].value for block in blocks for line in block.lines]
    if not values:
        return None
    over = "starts" if panel.given_alone else "seeds"
    return Forest(
        "Overfitting",
        "loss of success that neither difficulty nor a deadline explains; shaded: "
        f"±{EQUIVALENCE_MARGIN}, dashed: {FAIL_MARGIN}; intervals over {over}, {_level(values)}not "
        "adjusted",
        "loss of success by overfitting",
        difference_axis(values, margins=True),
        tuple(block for block in blocks if block.lines),
    )


def _gap_line(panel: Panel, row: str, cell: str, value: Estimate, tone: Tone = "soft") -> Line:
    return Line(
        panel.label(row),
        panel.label(cell),
        (row, cell),
        (Mark(value, tone, filled=tone != "soft"),),
        fixed(value.estimate, 2, True),
        " to ".join(map(fixed, value.ends)) if value.bounded else "",
        f"{panel.in_words(row)} on {panel.in_words(cell)}: overfitting {value}",
    )


def _level(values: Iterable[Estimate]) -> str:
    """The level that intervals share, before what else is said of them; empty without one."""
    levels = {value.level for value in values if value.level is not None}
    return f"{percent(levels.pop())}, " if len(levels) == 1 else ""


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


def mixtures_of(panel: Panel) -> list[Mixture]:
    """The panel's mixtures, in order."""
    return [_mixture(panel, remedy) for remedy in panel.remedies]


def remedy_forest(panel: Panel) -> Forest | None:
    """Every discretization in which single ones lose, by mixture; None without any."""
    blocks = tuple(
        Block(f"{panel.in_words(mixture.row.name)}: {mixture.members}", mixture.harmful)
        for mixture in mixtures_of(panel)
        if mixture.harmful
    )
    about = (
        "success; dot: mixture, with its interval; rings: single ones, red where they lose > 0.2"
    )
    title = "A remedy: training on a mixture"
    return Forest(title, about, "success", RATE_AXIS, blocks) if blocks else None


def _mixture(panel: Panel, remedy: Remedy) -> Mixture:
    harmful, others = [], []
    for cell in remedy.cells:
        own = panel.entry(remedy.row, cell.cell)
        entries = [panel.entry(single, cell.cell) for single in remedy.singles]
        rivals = sorted((e for e in entries if e is not None), key=lambda e: e.success.estimate)
        if own is None:
            continue
        line = _remedy_line(panel, own, rivals, cell)
        if cell.solved and cell.lost and rivals:
            harmful.append((rivals[0].success.estimate, line))
        else:
            others.append(line)
    worst_first = tuple(line for _, line in sorted(harmful, key=lambda pair: pair[0]))
    summary = remedy_summary(panel, remedy)
    return Mixture(panel.row(remedy.row), summary, worst_first, tuple(others))


def _remedy_line(panel: Panel, own: Entry, rivals: list[Entry], cell: RemedyCell) -> Line:
    """A mixture in one cell beside rows of a single discretization, the lowest first."""
    lost = {one.row: one.difference for one in cell.lost}
    mixture = panel.in_words(own.row)
    words, marks = [f"{panel.in_words(own.cell)}: {mixture} {own.success}"], []
    for rival in rivals:
        alone = Estimate(rival.success.estimate)
        marks.append(Mark(alone, "fails" if rival.row in lost else "soft", False, -0.35))
        less = f", {mixture} minus it {lost[rival.row]}" if rival.row in lost else ""
        words.append(f"{panel.in_words(rival.row)} {rival.success}{less}")
    rates = [fixed(rival.success.estimate) for rival in rivals]
    notes = ("trained there" if cell.member else "", "" if cell.solved else "no policy succeeds")
    return Line(
        "",
        own.cell,
        (own.row, own.cell),
        (*marks, Mark(own.success, "accent", down=0.35)),
        fixed(own.success.estimate),
        f"others {rates[0]} to {rates[-1]}" if rates else "no other row learned",
        "; ".join(words),
        ", ".join(filter(None, notes)),
    )


def paired_success(panel: Panel) -> Forest | None:
    """What every given policy loses of its success in each cell; None without any."""
    show = partial(fixed, digits=2)
    return _paired(panel, "success", "Success lost", difference_axis, show, EQUIVALENCE_MARGIN)


def paired_return(panel: Panel) -> Forest | None:
    """What every given policy loses of its mean return in each cell; None without any."""
    return _paired(panel, "return", "Mean return lost", value_axis, partial(compact, digits=3))


def _paired(
    panel: Panel,
    measure: str,
    title: str,
    axis: Callable[[Iterable[Estimate]], Axis],
    show: Callable[..., str],
    margin: float | None = None,
) -> Forest | None:
    """Blocks by policy, and by whether its plant was changed."""
    blocks: dict[str, list[Line]] = {}
    compared = [(one, found) for one in panel.paired if (found := one.difference(measure))]
    for one, (value, p) in compared:
        what = "variations" if panel.cell(one.cell).kind == "varied" else "discretizations"
        where = "at home" if one.against == "home" else panel.at_yardstick
        heading = f"{one.row}, {one.episodes} starts: {what} against what it does {where}"
        interval = f"{' to '.join(map(show, value.ends))}, " if value.bounded else ""
        number, significant = show(value.estimate, sign=True), p < ALPHA
        equal = margin is not None and value.is_within(margin)
        tone: Tone = "transfers" if equal else "accent" if significant else "soft"
        line = Line(
            "",
            panel.label(one.cell),
            (one.row, one.cell),
            (Mark(value, tone, filled=significant),),
            number,
            f"{interval}{p_text(p)}",
            f"{one.row} on {panel.in_words(one.cell)}: {title.lower()} {number}, {interval}"
            f"adjusted {p_text(p)}" + (", practically equal" if equal else ""),
        )
        blocks.setdefault(heading, []).append(line)
    if not blocks:
        return None
    values = [value for _, (value, _) in compared]
    equal_words = f"; green: practically equal (within ±{margin})" if margin else ""
    return Forest(
        title,
        f"positive is worse; intervals over starts, {_level(values)}not adjusted; p adjusted over "
        f"the cells; filled: below {ALPHA}{equal_words}",
        title.lower(),
        axis(values),
        tuple(Block(heading, lines) for heading, lines in blocks.items()),
    )


def checks_of(panel: Panel) -> dict[str, list[tuple[Entry | None, Entry]]]:
    """For every variation, its rows without it and with it.

    Rows are those that learned, or all where none of them met a variation; baselines that know
    nothing of the task and sweeps are left out.
    """
    swept = {name for names in panel.sweeps.values() for name in names.values()}
    named = {one["name"] for one in panel.spec.get("variations", ())} - swept
    checks: dict[str, list[tuple[Entry | None, Entry]]] = {}
    skilled = [row for row in panel.ordered_rows if row.name not in UNSKILLED]
    learned = [row for row in skilled if row.learned is not False]
    for rows in (learned, skilled):
        for row in rows if not checks else ():
            for cell in panel.cells:
                after = panel.entry(row.name, cell.name)
                if after is not None and cell.variation in named:
                    before = panel.entry(row.name, str(cell.at))
                    checks.setdefault(str(cell.variation), []).append((before, after))
    return checks


def check_forest(panel: Panel) -> Forest | None:
    """Success before and after every change of the plant or its delays; None without any."""
    blocks = tuple(
        Block(label, [_check_line(panel, *pair) for pair in pairs])
        for label, pairs in checks_of(panel).items()
    )
    about = "success with its interval over seeds: ring as specified, dot with the change; the loss"
    title = "Perturbations and latency"
    return Forest(title, about, "success", RATE_AXIS, blocks) if blocks else None


def _check_line(panel: Panel, before: Entry | None, after: Entry) -> Line:
    marks: tuple[Mark, ...] = (Mark(after.success, "accent", down=0.35),)
    was, loss = NONE, None
    if before is not None:
        marks = (Mark(before.success, "soft", filled=False, down=-0.35), *marks)
        was = fixed(before.success.estimate)
        loss = before.success.estimate - after.success.estimate
    return Line(
        after.row,
        (before or after).cell,
        (after.row, after.cell),
        marks,
        fixed(loss, sign=True),
        f"{was} → {fixed(after.success.estimate)}",
        f"{panel.in_words(after.row)}: success {before.success if before else 'not known'} "
        f"before, {after.success} on {panel.in_words(after.cell)}",
    )


def are_close(one: float, other: float) -> bool:
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
        """Number of rows that the cell and the reference agree about, for the page."""
        return len(self.of("true_pass")) + len(self.of("true_fail"))


def trust_of(panel: Panel) -> list[Trust]:
    """Every cell of the matrix that has a class against the reference, in column order."""
    trusts = []
    for cell in panel.columns:
        entries = (panel.entry(row.name, cell.name) for row in panel.ordered_rows)
        judged = tuple(e for e in entries if e is not None and e.reference_class)
        trusts += [Trust(cell, judged)] if judged and not cell.reference else []
    return trusts
