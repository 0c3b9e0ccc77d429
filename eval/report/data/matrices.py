"""Matrices: success, returns and energy of every row in every cell."""

from __future__ import annotations

from collections.abc import Callable
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

from ...panel.model.matrix import Cell, Entry, Row
from ...panel.model.panel import Group, Panel
from ...verdict.achievability import Achievability
from .trust import CLASS_WORDS

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
