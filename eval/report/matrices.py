"""Horizontal axes of success rates and of their differences."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from integ_gym.support.figures import ENERGY_FLOOR, symlog
from integ_gym.support.terminal import (
    NONE,
    compact,
    fixed,
    plural,
    true_minus,
)

from ..panel.result import Cell, Entry, Estimate, Group, Panel, Row
from ..verdict import Achievability

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
    low = math.floor(min([-0.2, *ends]) * 5.0 + 1e-9) / 5.0
    high = math.ceil(max([0.4, *ends]) * 5.0 - 1e-9) / 5.0
    low, high = max(low, -1.0), min(high, 1.0)
    size = size if high - low <= 1.6 else 0.5
    first, last = math.ceil(low / size - 1e-9), math.floor(high / size + 1e-9)
    ticks = [round(size * k, 2) for k in range(first, last + 1)]
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


KIND_WORDS: Final = {
    "trained": "trained on",
    "given": "given policies",
    "baseline": "baselines",
}
"""Headings of a matrix's blocks of rows, in order."""

Tone: TypeAlias = Literal["rate", "warm", "cool", "empty"]
"""The scale of a colour: of rates, of what is above or below zero, or none."""

HATCHED: Final[dict[Achievability, str]] = {
    "too_slow": "too slow: solved within two horizons alone",
    "unachievable": "unachievable: a search over controls misses the goal from most starts",
}
"""Cells that no policy is blamed for, in words; each has a hatching of its own."""

Shades: TypeAlias = tuple[tuple[Cell, "Shade | None"], ...]
"""Neighbouring cells; None where a row was not evaluated."""


@dataclass(frozen=True)
class Shade:
    """What one cell of a matrix shows.

    Attributes:
        text: the number.
        tone: scale of the colour.
        share: place on it, in [0, 1].
        marks: short signs under the number.
        words: all of it in words.
        home: whether the row was trained there.
        hatched: why the cell is hatched, a name in :data:`HATCHED`; None where it is not.
        span: where the interval of a rate begins and ends, in [0, 1]; None without one.
    """

    text: str
    tone: Tone
    share: float
    marks: tuple[str, ...]
    words: str
    home: bool
    hatched: Achievability | None = None
    span: tuple[float, float] | None = None


@dataclass(frozen=True)
class MatrixLine:
    """One row of a matrix, by groups of columns.

    Attributes:
        row: of the panel.
        name: of the row, as people read it.
        shades: of each group's cells.
    """

    row: Row
    name: str
    shades: tuple[tuple[Group, Shades], ...]


@dataclass(frozen=True)
class Block:
    """Rows of one kind under a heading."""

    title: str
    lines: tuple[MatrixLine, ...]


@dataclass(frozen=True)
class Matrix:
    """A matrix with its legend.

    Attributes:
        title: what it shows.
        about: how to read it.
        groups: columns.
        blocks: rows.
        ends: the lowest and the highest value of the scale.
        signed: whether the scale is that of `warm` and `cool`.
        notes: what else the legend says.
        periods: whether columns name their control period.
        hatchings: those that cells have, each with its words, in the legend's order.
    """

    title: str
    about: str
    groups: tuple[Group, ...]
    blocks: tuple[Block, ...]
    ends: tuple[str, str]
    signed: bool
    notes: tuple[str, ...]
    periods: bool
    hatchings: tuple[tuple[Achievability, str], ...] = ()


def success_matrix(panel: Panel) -> Matrix | None:
    """Matrix of success rates, None without any column."""
    columns = {cell.name for cell in panel.columns}
    entries = [entry for entry in panel.matrix if entry.cell in columns]
    classes = {entry.reference_class for entry in entries}
    signs = [
        words
        for words, there in (
            ("▲ false pass", "false_pass" in classes),
            ("▽ false fail", "false_fail" in classes),
            ("✕n episodes diverged", any(entry.diverged for entry in entries)),
        )
        if there
    ]
    found = {cell.achievability for cell in panel.columns}
    return _matrix(
        panel,
        "Success, trained on × evaluated on",
        "share of episodes that succeed" + _over_seeds(panel),
        ("0", "1"),
        (*signs, "columns: step in seconds, coarse to fine"),
        lambda entry, home: _success(entry, home, panel.cell(entry.cell)),
        hatchings=tuple((name, words) for name, words in HATCHED.items() if name in found),
    )


def return_matrix(panel: Panel) -> Matrix | None:
    """Matrix of returns, where no truth judges success; None if the panel has none."""
    found = [entry.returns.estimate for entry in panel.matrix if entry.returns is not None]
    if panel.truth is not None or not found:
        return None
    low, high = min(found), max(found)

    def shade(entry: Entry, home: bool) -> Shade:
        value = None if entry.returns is None else entry.returns.estimate
        share = 1.0 if value is None or high == low else (value - low) / (high - low)
        words = f"{_where(entry)}: return {compact(value, 4)}"
        return Shade(
            compact(value, 3), "empty" if value is None else "rate", share, (), words, home
        )

    return _matrix(
        panel,
        "Return",
        f"sum of rewards of an episode, the {mean_words(panel)} over episodes",
        (compact(low, 3), compact(high, 3)),
        ("columns: step in seconds, coarse to fine",),
        shade,
    )


def mean_words(panel: Panel) -> str:
    """Which mean of returns the panel has."""
    return "mean" if panel.given_alone else "interquartile mean"


def energy_matrix(panel: Panel) -> Matrix | None:
    """Matrix of energy residuals, None if the panel has none."""
    columns = {cell.name for cell in panel.columns}
    residuals = (entry.energy_residual for entry in panel.matrix if entry.cell in columns)
    sizes = [abs(residual.estimate) for residual in residuals if residual is not None]
    if not sizes:
        return None
    largest = max(sizes)
    floor = largest * ENERGY_FLOOR

    def shade(entry: Entry, home: bool) -> Shade:
        residual = entry.energy_residual
        if residual is None:
            words = f"{_where(entry)}: energy residual not known"
            return Shade(compact(None), "empty", 0.0, (), words, home)
        value = residual.estimate
        low, high = (compact(end, 3, True) for end in residual.ends)
        ends = f" ({low} to {high} J)" if residual.bounded else ""
        words = f"{_where(entry)}: {compact(value, 3, True)} J{ends}"
        tone: Tone = "warm" if value > 0.0 else "cool"
        share = symlog(abs(value), floor, largest)
        return Shade(compact(value, 2, True), tone, share, (), words, home)

    return _matrix(
        panel,
        "Energy that the numerics put in or took out",
        "energy residual in joules, sum over an episode" + _over_seeds(panel),
        (f"−{compact(largest)} J", f"+{compact(largest)} J"),
        (f"symmetric logarithm, linear below {compact(floor)} J",),
        shade,
        signed=True,
    )


def loss_matrix(panel: Panel) -> Matrix | None:
    """Matrix of losses of success, None if the panel has none."""
    columns = {cell.name for cell in panel.columns}
    found = [e for e in panel.matrix if e.home_drop is not None and e.cell in columns]
    if not found:
        return None

    def shade(entry: Entry, home: bool) -> Shade:
        loss = entry.home_drop
        if loss is None:
            words = f"{_where(entry)}: {'at home' if home else 'no loss is known'}"
            return Shade("home" if home else compact(None), "empty", 0.0, (), words, home)
        words = f"{_where(entry)}: {loss} of success lost against home"
        if entry.overfitting is not None:
            words += f", of it {entry.overfitting} by overfitting"
        tone: Tone = "warm" if loss.estimate > 0.0 else "cool"
        share = min(1.0, abs(loss.estimate))
        return Shade(fixed(loss.estimate, 2, True), tone, share, (), words, home)

    return _matrix(
        panel,
        "Loss of success",
        f"success lost against home{_over_seeds(panel)}; positive is worse",
        ("−1", "+1"),
        (),
        shade,
        signed=True,
    )


def time_matrix(panel: Panel) -> Matrix | None:
    """Matrix of times to success, None if no episode succeeds."""
    found = [e.time_to_success.estimate for e in panel.matrix if e.time_to_success is not None]
    if not found:
        return None
    low, high = min(found), max(found)

    def shade(entry: Entry, home: bool) -> Shade:
        if entry.time_to_success is None:
            words = f"{_where(entry)}: no episode succeeds"
            return Shade(compact(None), "empty", 0.0, (), words, home)
        value = entry.time_to_success.estimate
        share = 1.0 if high == low else (high - value) / (high - low)
        words = (
            f"{_where(entry)}: {compact(value, 3)} s, mean of "
            f"{plural(entry.time_to_success_episodes, 'episode')} that succeed"
        )
        return Shade(compact(value, 3), "rate", share, (), words, home)

    return _matrix(
        panel,
        "Time to success",
        "time to success of the episodes that succeed, s",
        (f"{compact(high, 3)} s", f"{compact(low, 3)} s"),
        (),
        shade,
    )


def _matrix(
    panel: Panel,
    title: str,
    about: str,
    ends: tuple[str, str],
    notes: tuple[str, ...],
    shade: Callable[[Entry, bool], Shade],
    *,
    signed: bool = False,
    hatchings: tuple[tuple[Achievability, str], ...] = (),
) -> Matrix | None:
    """Rows by kind; ``shade`` turns an entry, and whether it is at home, into what it shows."""
    if not panel.columns:
        return None
    blocks = []
    for kind, heading in KIND_WORDS.items():
        rows = [row for row in panel.ordered_rows if row.kind == kind]
        if rows:
            blocks.append(Block(heading, tuple(_line(panel, row, shade) for row in rows)))
    periods = panel.mixed_periods
    return Matrix(
        title, about, panel.groups, tuple(blocks), ends, signed, notes, periods, hatchings
    )


def _line(panel: Panel, row: Row, shade: Callable[[Entry, bool], Shade]) -> MatrixLine:
    def shown(cell: Cell) -> Shade | None:
        entry = panel.entry(row.name, cell.name)
        return None if entry is None else shade(entry, cell.name in row.shares)

    return MatrixLine(
        row,
        panel.called(row.name),
        tuple((group, tuple((c, shown(c)) for c in group.cells)) for group in panel.groups),
    )


def solved_words(cell: Cell) -> str:
    """Whether a cell can be solved, and why; empty where it was not asked."""
    if cell.achievability is None:
        return ""
    status = cell.achievability.replace("_", " ")
    return f"{status}: {true_minus(cell.achievability_reason or NONE)}"


def _where(entry: Entry) -> str:
    return f"{entry.row}, evaluated on {entry.cell}"


def _success(entry: Entry, home: bool, cell: Cell) -> Shade:
    words = [f"{_where(entry)}: success {entry.success}", plural(entry.episodes, "episode")]
    marks = []
    if home:
        words.append("its training discretization")
    if entry.reference_class is not None:
        words.append(f"a {CLASS_WORDS[entry.reference_class]}")
        marks += {"false_pass": ["▲"], "false_fail": ["▽"]}.get(entry.reference_class, [])
    if entry.diverged:
        words.append(f"{entry.diverged} diverged")
        marks.append(f"✕{entry.diverged}")
    hatched = cell.achievability if cell.achievability in HATCHED else None
    if hatched is not None:
        words.append(f"the cell is {solved_words(cell)}")
    rate = entry.success.estimate
    span = entry.success.ends if entry.success.bounded else None
    return Shade(fixed(rate), "rate", rate, tuple(marks), "; ".join(words), home, hatched, span)


def _over_seeds(panel: Panel) -> str:
    return "" if panel.given_alone else ", mean over training seeds"


CLASS_WORDS: Final = {
    "true_pass": "true pass",
    "false_pass": "false pass",
    "false_fail": "false fail",
    "true_fail": "true fail",
}
"""The classes against the reference in words."""
