"""Matrices: rows by what was trained on, columns by what was judged on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, TypeAlias

from integ_gym.support.figures import (
    INK,
    SOFT,
    SUNK,
    blank_figure,
    inch_canvas,
    ink_on,
    plain,
)
from integ_gym.support.terminal import NONE, step

from ....panel.model.panel import Group
from ...data.matrices import Matrix, MatrixLine, Shade
from ..matrix import draw_box, shade_colour, stripes
from .sheet import LETTER, LINE_HEIGHT, TYPE, short, width_for

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_EDGE, _HEIGHT, _GROUP_GAP, _HEADS = 0.06, 0.31, 0.07, 0.86  # inches
_NARROWEST: Final = 0.29
"""Width of a column, inches."""

_LONGEST: Final = 1.7
"""Room for the name of a row, inches."""

Places: TypeAlias = dict[str, tuple[float, float]]
"""Name of a cell to the left edge and the width of its column, inches."""


def print_matrix(matrix: Matrix) -> Figure:
    """Numbers in coloured cells; what they mean in words below."""
    lines = [line for block in matrix.blocks for line in block.lines]
    left = _EDGE + LINE_HEIGHT + 0.1 + LETTER * max(len(_name(line)) for line in lines)
    places = _places(matrix, lines, left)
    right = max(x + width for x, width in places.values())
    wide = width_for(right + _EDGE)
    notes = _notes(matrix)
    top = _EDGE + _HEADS
    bottom = top + _HEIGHT * len(lines)
    figure = blank_figure(wide, bottom + 0.1 + LINE_HEIGHT * (1.2 + len(notes)))
    axes = inch_canvas(figure)
    for group in matrix.groups:
        _draw_head(axes, group, places, top)
    for number, line in enumerate(lines):
        _draw_row(axes, line, places, top + _HEIGHT * number, left)
    axes.text(
        (left + right) / 2.0, bottom + LINE_HEIGHT, "judged on (integrator above, step in s)",
        ha="center", va="center", **TYPE,
    )  # fmt: skip
    y = top
    for block in matrix.blocks:
        tall = _HEIGHT * len(block.lines)
        axes.text(
            _EDGE + 0.5 * LINE_HEIGHT, y + tall / 2.0, short(block.title, tall),
            ha="center", va="center", rotation=90, **TYPE,
        )  # fmt: skip
        y += tall
    for number, note in enumerate(notes):
        axes.text(_EDGE, bottom + LINE_HEIGHT * (number + 2.4), note, va="center", **TYPE)
    return figure


def _name(line: MatrixLine) -> str:
    return short(line.name, _LONGEST)


def _notes(matrix: Matrix) -> list[str]:
    signs = [note for note in matrix.notes if not note.startswith("columns:")]
    hatched = [plain(words, 100) for _, words in matrix.hatchings]
    said = ", ".join(["framed: trained here", *signs])
    return [plain(said, 110), *(f"hatched: {words}" for words in hatched)]


def _places(matrix: Matrix, lines: Sequence[MatrixLine], left: float) -> Places:
    """Every column, as wide as its numbers need."""
    longest: dict[str, int] = {}
    for line in lines:
        for _, shades in line.shades:
            for cell, shade in shades:
                size = 0 if shade is None else len(shade.text)
                longest[cell.name] = max(size, longest.get(cell.name, 0))
    places, x = {}, left
    for group in matrix.groups:
        for one in group.cells:
            width = max(_NARROWEST, LETTER * longest.get(one.name, 0) + 0.04)
            places[one.name] = (x, width)
            x += width
        x += _GROUP_GAP
    return places


def _draw_head(axes: Axes, group: Group, places: Places, top: float) -> None:
    """The integrator's name above its steps, which stand upright."""
    first, last = places[group.cells[0].name][0], sum(places[group.cells[-1].name])
    name = "truth" if group.reference else plain(group.label, 30).replace("_", "\n")
    axes.text(
        (first + last) / 2.0, top - 0.5, name, ha="center", va="bottom", linespacing=1.0, **TYPE
    )
    axes.plot([first + 0.03, last - 0.03], [top - 0.47] * 2, color=INK, linewidth=0.6)
    for one in group.cells:
        text = "" if one.reference else step(one.dt)
        x, width = places[one.name]
        axes.text(x + width / 2.0, top - 0.04, text, ha="center", va="bottom", rotation=90, **TYPE)


def _draw_row(axes: Axes, line: MatrixLine, places: Places, y: float, left: float) -> None:
    middle = y + _HEIGHT / 2.0
    axes.text(left - 0.05, middle, _name(line), ha="right", va="center", **TYPE)
    for _, shades in line.shades:
        for one, shade in shades:
            x, width = places[one.name]
            _draw_cell(axes, shade, (x, y, width))


def _draw_cell(axes: Axes, shade: Shade | None, at: tuple[float, float, float]) -> None:
    x, y, cell = at
    size = cell, _HEIGHT
    if shade is None:
        draw_box(axes, (x, y), size, 0.01, facecolor=SUNK, linewidth=0)
        axes.text(x + cell / 2.0, y + _HEIGHT / 2.0, NONE, ha="center", va="center", **TYPE)
        return
    colour = shade_colour(shade)
    ink = SOFT if shade.tone == "empty" else ink_on(colour)
    draw_box(axes, (x, y), size, 0.01, facecolor=colour, linewidth=0)
    if shade.hatched:
        draw_box(axes, (x, y), size, 0.01, linewidth=0, **stripes(shade.hatched, colour, ink))
    if shade.home:
        draw_box(axes, (x, y), size, 0.02, fill=False, edgecolor=INK, linewidth=1.3)
    behind = {"facecolor": colour, "edgecolor": "none", "pad": 0.5} if shade.hatched else None
    text = "\n".join(filter(None, (shade.text, " ".join(shade.marks))))
    axes.text(
        x + cell / 2.0, y + _HEIGHT / 2.0, text, ha="center", va="center", linespacing=0.95,
        bbox=behind, **{**TYPE, "color": ink},
    )  # fmt: skip
