"""Layout of a matrix: rows by kind, columns by integrator, the reference set apart."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Final

from integ_gym.eval.figure_style import (
    INK,
    LINE,
    SOFT,
    SUNK,
    blank_figure,
    draw_heading,
    inch_canvas,
    plain,
)
from integ_gym.eval.figures.cell import HEIGHT, WIDTH, box, cell_text
from integ_gym.eval.formatting import NONE, step
from integ_gym.eval.panel_model import Cell, Entry, Panel, Row
from integ_gym.eval.report_data.words import KIND_WORDS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_GROUP_GAP: Final = 0.14  # inches between groups of columns
_TRUTH_GAP: Final = 0.34
_BOLD: Final = 0.0098  # width of a bold letter, inches per point of its size
_BLOCK_GAP: Final = 0.42  # inches between blocks of rows, where their heading stands


def draw_matrix(
    panel: Panel,
    title: str,
    about: str,
    draw: Callable[[Axes, float, float, Entry, bool], None],
    legend: Callable[[Axes, float, float], None],
) -> Figure:
    """Rows by kind, columns by integrator, the reference set apart."""
    left, top = 2.75, 1.62
    columns, right = _column_places(panel, left)
    rows, bottom = _row_places(panel, top)
    figure = blank_figure(max(right + 0.35, 7.2), bottom + 0.85)
    axes = inch_canvas(figure)
    draw_heading(axes, 0.3, title, about)
    _column_heads(axes, panel, columns, top, bottom)
    for row, y, heading in rows:
        if heading:
            axes.text(0.3, y - 0.1, heading, size=8.5, color=SOFT, va="baseline")
        name = plain(row.name, 38)
        axes.text(
            left - 0.14, y + HEIGHT / 2, name, size=_fitting([name], left - 0.44, 9.0),
            color=INK, ha="right", va="center", weight="bold",
        )  # fmt: skip
        for cell, x in columns:
            entry = panel.entry(row.name, cell.name)
            if entry is None:
                box(axes, x, y, SUNK)
                cell_text(axes, x, y, NONE, SOFT)
            else:
                draw(axes, x, y, entry, cell.name in row.shares)
    legend(axes, left, bottom + 0.3)
    return figure


def _column_places(panel: Panel, left: float) -> tuple[list[tuple[Cell, float]], float]:
    """Left edge of every column in inches, and the right edge of the last."""
    places: list[tuple[Cell, float]] = []
    x = left
    for number, group in enumerate(panel.groups):
        if number:
            x += _TRUTH_GAP if group.reference else _GROUP_GAP
        for cell in group.cells:
            places.append((cell, x))
            x += WIDTH
    return places, x


def _row_places(panel: Panel, top: float) -> tuple[list[tuple[Row, float, str]], float]:
    """Top edge and heading of every row, and the bottom edge of the last."""
    places: list[tuple[Row, float, str]] = []
    y, last = top, ""
    for row in panel.ordered_rows:
        heading = "" if row.kind == last else KIND_WORDS[row.kind]
        if heading and last:
            y += _BLOCK_GAP - 0.06
        places.append((row, y, heading))
        y, last = y + HEIGHT, row.kind
    return places, y


def _column_heads(
    axes: Axes, panel: Panel, columns: list[tuple[Cell, float]], top: float, bottom: float
) -> None:
    """Names of integrators over their steps."""
    place = {cell.name: x for cell, x in columns}
    widths = [len(group.cells) * WIDTH + 0.1 for group in panel.groups]
    names = ["truth" if group.reference else group.label for group in panel.groups]
    heads = [_head(name, width) for name, width in zip(names, widths, strict=True)]
    size = min(_fitting(head, width, 9.5) for head, width in zip(heads, widths, strict=True))
    for group, lines in zip(panel.groups, heads, strict=True):
        first, last = place[group.cells[0].name], place[group.cells[-1].name] + WIDTH
        axes.text(
            (first + last) / 2, top - 0.62, "\n".join(lines), color=INK, ha="center",
            size=size, weight="bold", va="bottom", linespacing=1.0,
        )  # fmt: skip
        if group.reference:
            edge = first - _TRUTH_GAP / 2
            axes.plot([edge, edge], [top - 0.75, bottom], color=INK, linewidth=1.2)
        else:
            axes.plot([first + 0.05, last - 0.05], [top - 0.54] * 2, color=LINE, linewidth=1)
        for cell in group.cells:
            _column_head(axes, panel, cell, place[cell.name] + WIDTH / 2, top)


def _fitting(lines: Sequence[str], width: float, size: float) -> float:
    """Size of bold text in points, at most ``size``, at which lines fit a width in inches."""
    return max(5.0, min(size, width / (_BOLD * max(len(line) for line in lines))))


def _head(label: str, width: float) -> list[str]:
    """A group's name on one line, or cut after underscores and spaces into two where narrow."""
    most = int(width / (_BOLD * 6.5))
    text = plain(label, max(2 * most, 8))
    if len(text) * _BOLD * 9.5 <= width:
        return [text]
    cuts = [place + 1 for place, letter in enumerate(text[:-1]) if letter in "_ "]
    cut = min(cuts, key=lambda place: abs(place - len(text) / 2), default=len(text))
    return [line.strip() for line in (text[:cut], text[cut:]) if line.strip()]


def _column_head(axes: Axes, panel: Panel, cell: Cell, x: float, top: float) -> None:
    text = "reference" if cell.reference else step(cell.dt)
    axes.text(x, top - 0.36, text, size=7.5, color=SOFT, ha="center", va="baseline")
    if panel.mixed_periods:
        period = f"every {step(cell.control_period)}"
        axes.text(x, top - 0.22, period, size=6.5, color=SOFT, ha="center", va="baseline")
