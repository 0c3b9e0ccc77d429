"""Matrices: what every row did in every cell, as coloured numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal, TypeAlias

from integ_gym.support.figures import ENERGY_FLOOR, ink_on, success_colour, symlog
from integ_gym.support.terminal import NONE, compact, fixed, plural

from ..panel.cells import Cell
from ..panel.conclusions import contract_reason, solvable_reason
from ..panel.result import Entry, Group, Panel, Row
from ..verdict import Achievability

KIND_WORDS: Final = {
    "trained": "trained on",
    "given": "given policies",
    "baseline": "baselines",
}
"""Headings of a matrix's blocks of rows, in order."""

CLASS_WORDS: Final = {
    "true_pass": "true pass",
    "false_pass": "false pass",
    "false_fail": "false fail",
    "true_fail": "true fail",
}
"""The classes against the reference in words."""

HATCHED: Final[dict[Achievability, str]] = {
    "too_slow": "too slow: solved within two horizons alone",
    "unachievable": "unachievable: a search over controls misses the goal from most starts",
}
"""Cells that no policy is blamed for, in words; each has a hatching of its own."""

_STEPS: Final = "columns: step in seconds, coarse to fine"

Tone: TypeAlias = Literal["rate", "warm", "cool", "empty"]
"""The scale of a colour: of rates, of what is above or below zero, or none."""


@dataclass(frozen=True)
class Shade:
    """What one cell of a matrix shows.

    Attributes:
        text: the number.
        tone: scale of the colour.
        share: place on it, in [0, 1].
        words: all of it in words.
        marks: short signs under the number.
        hatched: why the cell is hatched, a name in :data:`HATCHED`; None where it is not.
        span: where the interval of a rate begins and ends, in [0, 1]; None without one.
        home: whether the row was trained there.
    """

    text: str
    tone: Tone
    share: float
    words: str
    marks: tuple[str, ...] = ()
    hatched: Achievability | None = None
    span: tuple[float, float] | None = None
    home: bool = False


@dataclass(frozen=True)
class MatrixLine:
    """One row of a matrix.

    Attributes:
        row: of the panel.
        name: of the row, as people read it.
        shades: what it shows by name of the cell, in the order of the columns; None where the row
            was not evaluated.
    """

    row: Row
    name: str
    shades: Mapping[str, Shade | None]


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
    hatchings: tuple[tuple[Achievability, str], ...]


def success_matrix(panel: Panel) -> Matrix | None:
    """Matrix of success rates, None without any column."""
    entries = _of_columns(panel)
    classes = {entry.reference_class for entry in entries}
    signs = {
        "▲ false pass": "false_pass" in classes,
        "▽ false fail": "false_fail" in classes,
        "✕n episodes diverged": any(e.diverged for e in entries),
        "≠ contract differs, no verdict": any(
            panel.broken_contract(e.row, e.cell) for e in entries
        ),
    }

    def shade(entry: Entry, home: bool) -> Shade:
        cell, rate = panel.cell(entry.cell), entry.success
        words, marks = [f"success {rate}", plural(entry.episodes, "episode")], []
        if home:
            words.append("its training discretization")
        if entry.reference_class is not None:
            words.append(f"a {CLASS_WORDS[entry.reference_class]}")
            marks += {"false_pass": ["▲"], "false_fail": ["▽"]}.get(entry.reference_class, [])
        if entry.diverged:
            words.append(f"{entry.diverged} diverged")
            marks.append(f"✕{entry.diverged}")
        broken = contract_reason(panel, entry.row, entry.cell)
        if broken:
            words.append(broken.removesuffix("."))
            marks.append("≠")
        hatched = cell.achievability if cell.achievability in HATCHED else None
        if hatched is not None:
            words.append(f"the cell is {explain_solvability(panel, cell)}")
        span, about = rate.ends if rate.bounded else None, "; ".join(words)
        text = fixed(rate.estimate)
        return Shade(text, "rate", rate.estimate, about, tuple(marks), hatched, span)

    found = {cell.achievability for cell in panel.columns}
    return _matrix(
        panel,
        "Success, trained on × evaluated on",
        "share of episodes that succeed" + _over_seeds(panel),
        ("0", "1"),
        shade,
        (*(words for words, there in signs.items() if there), _STEPS),
        hatchings=tuple((name, words) for name, words in HATCHED.items() if name in found),
    )


def return_matrix(panel: Panel) -> Matrix | None:
    """Matrix of returns, where no truth judges success; None if the panel has none."""
    returns = [entry.returns.estimate for entry in panel.matrix if entry.returns is not None]
    if panel.truth is not None or not returns:
        return None
    low, high = min(returns), max(returns)

    def shade(entry: Entry, home: bool) -> Shade:
        value = None if entry.returns is None else entry.returns.estimate
        share = 1.0 if value is None or high == low else (value - low) / (high - low)
        tone: Tone = "empty" if value is None else "rate"
        return Shade(compact(value, 3), tone, share, f"return {compact(value, 4)}")

    about = f"sum of rewards of an episode, the {mean_words(panel)} over episodes"
    return _matrix(panel, "Return", about, (compact(low, 3), compact(high, 3)), shade, (_STEPS,))


def energy_matrix(panel: Panel) -> Matrix | None:
    """Matrix of energy residuals, None if the panel has none."""
    known = (e.energy_residual for e in _of_columns(panel) if e.energy_residual is not None)
    largest = max((abs(one.estimate) for one in known), default=None)
    if largest is None:
        return None
    floor = largest * ENERGY_FLOOR

    def shade(entry: Entry, home: bool) -> Shade:
        residual = entry.energy_residual
        if residual is None:
            return Shade(NONE, "empty", 0.0, "energy residual not known")
        value = residual.estimate
        low, high = (compact(end, 3, True) for end in residual.ends)
        ends = f" ({low} to {high} J)" if residual.bounded else ""
        words, share = f"{compact(value, 3, True)} J{ends}", symlog(abs(value), floor, largest)
        return Shade(compact(value, 2, True), "warm" if value > 0.0 else "cool", share, words)

    return _matrix(
        panel,
        "Energy that the numerics put in or took out",
        "energy residual in joules, sum over an episode" + _over_seeds(panel),
        (f"−{compact(largest)} J", f"+{compact(largest)} J"),
        shade,
        (f"symmetric logarithm, linear below {compact(floor)} J",),
        signed=True,
    )


def loss_matrix(panel: Panel) -> Matrix | None:
    """Matrix of losses of success, None if the panel has none."""
    if all(entry.home_drop is None for entry in _of_columns(panel)):
        return None

    def shade(entry: Entry, home: bool) -> Shade:
        loss = entry.home_drop
        if loss is None:
            broken = contract_reason(panel, entry.row, entry.cell)
            words = "at home" if home else broken.removesuffix(".") or "no loss is known"
            return Shade("home" if home else NONE, "empty", 0.0, words)
        words = f"{loss} of success lost against home"
        if entry.overfitting is not None:
            words += f", of it {entry.overfitting} by overfitting"
        tone: Tone = "warm" if loss.estimate > 0.0 else "cool"
        return Shade(fixed(loss.estimate, 2, True), tone, min(1.0, abs(loss.estimate)), words)

    about = f"success lost against home{_over_seeds(panel)}; positive is worse"
    return _matrix(panel, "Loss of success", about, ("−1", "+1"), shade, signed=True)


def time_matrix(panel: Panel) -> Matrix | None:
    """Matrix of times to success, None if no episode succeeds."""
    times = [e.time_to_success.estimate for e in panel.matrix if e.time_to_success is not None]
    if not times:
        return None
    low, high = min(times), max(times)

    def shade(entry: Entry, home: bool) -> Shade:
        if entry.time_to_success is None:
            return Shade(NONE, "empty", 0.0, "no episode succeeds")
        value = entry.time_to_success.estimate
        share = 1.0 if high == low else (high - value) / (high - low)
        episodes = plural(entry.time_to_success_episodes, "episode")
        words = f"{compact(value, 3)} s, mean of {episodes} that succeed"
        return Shade(compact(value, 3), "rate", share, words)

    about = "time to success of the episodes that succeed, s"
    ends = f"{compact(high, 3)} s", f"{compact(low, 3)} s"
    return _matrix(panel, "Time to success", about, ends, shade)


def command_matrix(panel: Panel) -> Matrix | None:
    """Matrix of command errors and of falls, None where nothing is commanded and measured."""
    errors = [e.command_error.estimate for e in _of_columns(panel) if e.command_error is not None]
    if not errors:
        return None
    low, high = max(min(errors), 1e-9), max(errors)

    def shade(entry: Entry, home: bool) -> Shade:
        if entry.command_error is None:
            return Shade(NONE, "empty", 0.0, "nothing is commanded and measured")
        value, fallen = entry.command_error.estimate, entry.terminated or 0
        share = 1.0 - math.log(max(value, low) / low) / math.log(high / low) if high > low else 1.0
        ended = f"{fallen} of {plural(entry.episodes, 'episode')} end before their time"
        words = f"misses its command by {compact(value, 3)}; {ended}"
        return Shade(compact(value, 3), "rate", share, words, (f"↓{fallen}",) if fallen else ())

    about = "measured minus commanded, root mean square over an episode, SI units"
    notes = ("↓n episodes ended before their time, as by a fall", "logarithmic scale")
    ends = compact(high, 3), compact(low, 3)
    return _matrix(panel, "Command error and falls", about, ends, shade, notes)


def shade_style(shade: Shade) -> str:
    """Inline style of a cell on the page."""
    if shade.tone == "rate":
        background = success_colour(shade.share)
        low, high = (f"{100.0 * end:.0f}%" for end in shade.span or (0.0, 0.0))
        whisker = f";--l:{low};--h:{high}" if shade.span else ""
        return f"background-color:{background};color:{ink_on(background)}{whisker}"
    return "" if shade.tone == "empty" else f"--a:{shade.share:.3f}"


def mean_words(panel: Panel) -> str:
    """Which mean of returns the panel has."""
    return "mean" if panel.given_alone else "interquartile mean"


def explain_solvability(panel: Panel, cell: Cell) -> str:
    """Whether a cell can be solved, and why; empty where it was not asked."""
    if cell.achievability is None:
        return ""
    status = cell.achievability.replace("_", " ")
    return f"{status}: {solvable_reason(panel, cell)}"


def _of_columns(panel: Panel) -> list[Entry]:
    columns = {cell.name for cell in panel.columns}
    return [entry for entry in panel.matrix if entry.cell in columns]


def _over_seeds(panel: Panel) -> str:
    return "" if panel.given_alone else ", mean over training seeds"


def _matrix(
    panel: Panel,
    title: str,
    about: str,
    ends: tuple[str, str],
    shade: Callable[[Entry, bool], Shade],
    notes: tuple[str, ...] = (),
    *,
    signed: bool = False,
    hatchings: tuple[tuple[Achievability, str], ...] = (),
) -> Matrix | None:
    """Rows by kind; ``shade`` turns an entry, and whether it is at home, into what it shows."""
    if not panel.columns:
        return None

    def line(row: Row) -> MatrixLine:
        shades: dict[str, Shade | None] = {}
        for cell in panel.columns:
            entry, home = panel.entry(row.name, cell.name), cell.name in row.shares
            shades[cell.name] = None
            if entry is not None:
                one, there = shade(entry, home), panel.in_words(cell.name)
                where = f"{panel.in_words(row.name)}, evaluated on {there}"
                shades[cell.name] = replace(one, home=home, words=f"{where}: {one.words}")
        return MatrixLine(row, panel.label(row.name), shades)

    blocks = tuple(
        Block(heading, tuple(map(line, rows)))
        for kind, heading in KIND_WORDS.items()
        if (rows := [row for row in panel.ordered_rows if row.kind == kind])
    )
    periods = panel.mixed_periods
    return Matrix(title, about, panel.groups, blocks, ends, signed, notes, periods, hatchings)
