"""The report's matrices: success, returns and energy of every row in every cell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from integ_gym.eval.colours import ENERGY_FLOOR, ink_on, success_colour, symlog
from integ_gym.eval.formatting import NONE, compact, fixed, plural
from integ_gym.eval.panel_model import Cell, Entry, Estimate, Group, Panel, Row
from integ_gym.eval.report_data.words import CLASS_WORDS, KIND_WORDS


@dataclass(frozen=True)
class Shade:
    """What one cell of a matrix shows.

    Attributes
    ----------
    text, style, tone
        The number, its inline style and its class.
    marks
        Short signs under the number.
    title
        The cell in words.
    """

    text: str
    style: str
    tone: str
    marks: tuple[str, ...]
    title: str
    entry: Entry
    home: bool


@dataclass(frozen=True)
class Line:
    """One row of a matrix."""

    row: Row
    shades: tuple[tuple[Group, tuple[tuple[Cell, Shade | None], ...]], ...]


@dataclass(frozen=True)
class Block:
    """Rows of one kind under a heading."""

    title: str
    lines: tuple[Line, ...]


def success_matrix(panel: Panel) -> tuple[Block, ...]:
    """Matrix of success rates."""
    return _matrix(panel, _success_cell)


def return_matrix(panel: Panel) -> dict[str, Any] | None:
    """Matrix of returns, where no truth judges success; None if the panel has none."""
    shown = [e.returns.estimate for e in panel.matrix if e.returns is not None]
    if panel.truth is not None or not shown:
        return None
    low, high = min(shown), max(shown)

    def shade(entry: Entry, home: bool) -> Shade:
        return _return_cell(entry, home, low, high)

    return {"blocks": _matrix(panel, shade), "low": low, "high": high}


def energy_matrix(panel: Panel) -> dict[str, Any] | None:
    """Matrix of energy residuals, None if the panel has none."""
    largest = largest_residual(panel)
    if largest is None:
        return None
    floor = largest * ENERGY_FLOOR

    def shade(entry: Entry, home: bool) -> Shade:
        return _energy_cell(entry, home, floor, largest)

    return {"blocks": _matrix(panel, shade), "largest": largest, "floor": floor}


def _matrix(panel: Panel, shade: Callable[[Entry, bool], Shade]) -> tuple[Block, ...]:
    """Rows of a matrix by kind; ``shade`` turns an entry into what its cell shows."""
    blocks = []
    for kind, title in KIND_WORDS.items():
        rows = [row for row in panel.ordered_rows if row.kind == kind]
        if rows:
            blocks.append(Block(title, tuple(_line(panel, row, shade) for row in rows)))
    return tuple(blocks)


def _line(panel: Panel, row: Row, shade: Callable[[Entry, bool], Shade]) -> Line:
    shades = []
    for group in panel.groups:
        cells = []
        for cell in group.cells:
            entry, home = panel.entry(row.name, cell.name), cell.name in row.shares
            cells.append((cell, None if entry is None else shade(entry, home)))
        shades.append((group, tuple(cells)))
    return Line(row, tuple(shades))


def _success_cell(entry: Entry, home: bool) -> Shade:
    rate = entry.success.estimate
    background = success_colour(rate)
    style = f"background:{background};color:{ink_on(background)}"
    marks = []
    if entry.reference_class == "false_pass":
        marks.append("▲")
    if entry.reference_class == "false_fail":
        marks.append("▽")
    if entry.diverged:
        marks.append(f"✕{entry.diverged}")
    return Shade(fixed(rate), style, "", tuple(marks), _words(entry, home), entry, home)


def _words(entry: Entry, home: bool) -> str:
    """A cell of the success matrix in words, for tooltips and screen readers."""
    parts = [f"{entry.row}, evaluated on {entry.cell}: success {entry.success}"]
    parts.append(plural(entry.episodes, "episode"))
    if home:
        parts.append("its training discretization")
    if entry.reference_class:
        parts.append(f"a {CLASS_WORDS[entry.reference_class]}")
    if entry.diverged:
        parts.append(f"{entry.diverged} diverged")
    return "; ".join(parts)


def _return_cell(entry: Entry, home: bool, low: float, high: float) -> Shade:
    value = None if entry.returns is None else entry.returns.estimate
    title = f"{entry.row}, evaluated on {entry.cell}: return {compact(value, 4)}"
    if value is None:
        return Shade(NONE, "", "empty", (), title, entry, home)
    background = success_colour((value - low) / (high - low) if high > low else 1.0)
    style = f"background:{background};color:{ink_on(background)}"
    return Shade(compact(value, 3), style, "", (), title, entry, home)


def _energy_cell(entry: Entry, home: bool, floor: float, largest: float) -> Shade:
    residual = entry.energy_residual
    value = None if residual is None else residual.estimate
    alpha = 0.0 if value is None else symlog(abs(value), floor, largest)
    tone = "empty" if value is None else "warm" if value > 0.0 else "cool"
    spread = "" if residual is None or not residual.bounded else _ends(residual)
    title = f"{entry.row}, evaluated on {entry.cell}: "
    title += "energy residual not known" if value is None else f"{compact(value, 3, True)} J"
    text = compact(value, 2, True)
    return Shade(text, f"--a:{alpha:.3f}", tone, (), title + spread, entry, home)


def _ends(value: Estimate) -> str:
    low, high = (compact(end, 3, True) for end in value.ends)
    return f" ({low} to {high} J)"


def largest_residual(panel: Panel) -> float | None:
    """Largest size of an energy residual in the matrix, J; None if it has none."""
    columns = {cell.name for cell in panel.columns}
    found = (entry.energy_residual for entry in panel.matrix if entry.cell in columns)
    return max((abs(value.estimate) for value in found if value is not None), default=None)
