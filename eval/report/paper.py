"""Figures for print: one column wide, as PDF."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from integ_gym.support.figures import (
    INK,
    LINE,
    PALETTE,
    PAPER,
    SOFT,
    SUNK,
    Entry,
    axes_at,
    blank_figure,
    inch_canvas,
    ink_on,
    plain,
    scheme_entries,
)
from integ_gym.support.terminal import NONE, step

from ..panel.result import Group
from ..verdict import EQUIVALENCE_MARGIN, FAIL_MARGIN
from .drawing import (
    draw_box,
    draw_series,
    shade_colour,
    stripes,
)
from .forests import Forest, Line, Mark
from .ladders import LadderPlot, LadderPlots, thinned
from .matrices import (
    RATE_AXIS,
    Axis,
    Matrix,
    MatrixLine,
    Shade,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


COLUMN: Final = 3.35
"""Width of a column, inches: what IEEE, ACM and Elsevier have, to within 0.2."""

PAGE: Final = 6.9
"""Width of both columns of a page, inches."""

SIZE: Final = 8.0
"""Of all type, points."""

LETTER: Final = 0.063
"""Width of a letter of that size, inches."""

LINE_HEIGHT: Final = 0.155
"""Inches from line to line of type."""

TYPE: Final[dict[str, Any]] = {"size": SIZE, "color": INK}
"""Properties of a text, as Matplotlib takes them."""


def short(name: str, room: float) -> str:
    """Names of rows and cells with no more than they need, cut to a width in inches."""
    return plain(name.replace(" dt=", " "), int(room / LETTER))


def width_for(needed: float) -> float:
    """A column where that is enough, else the page, else what is needed, inches."""
    return next((width for width in (COLUMN, PAGE) if needed <= width), needed)


def framed(axes: Axes, across: str, up: str) -> None:
    """Label axes; with ticks, and without a frame above and at the right."""
    axes.set_xlabel(across, labelpad=2, **TYPE)
    axes.set_ylabel(up, labelpad=2, **TYPE)
    axes.tick_params(labelsize=SIZE, colors=INK, length=2.5, width=0.6, pad=2)
    axes.set_facecolor("none")
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set(color=INK, linewidth=0.6)
    axes.grid(color=LINE, linewidth=0.5)
    axes.set_axisbelow(True)


_PITCH: Final = 1.7 * LINE_HEIGHT
_HEADING: Final = 1.5 * LINE_HEIGHT
_EDGE, _RIGHT, _BOTTOM = 0.12, 0.5, 0.4
_WHISKER: Final = 0.03


def print_forest(forest: Forest) -> Figure:
    """All blocks, one under the other, on one axis."""
    tall = sum(_HEADING + _PITCH * len(block.lines) for block in forest.blocks)
    figure = blank_figure(COLUMN, tall + _BOTTOM + 0.06)
    width = COLUMN - _EDGE - _RIGHT
    axes = axes_at(figure, _EDGE, _BOTTOM, width, tall)
    _draw_axis(axes, forest.axis, forest.along, tall)
    canvas = inch_canvas(figure)
    y = 0.0
    for block in forest.blocks:
        heading = short(block.title, COLUMN - 2 * _EDGE)
        canvas.text(_EDGE, 0.06 + y + 0.6 * _HEADING, heading, va="center", weight="bold", **TYPE)
        y += _HEADING
        for line in block.lines:
            _draw_line(axes, canvas, line, forest.axis, y)
            y += _PITCH
    return figure


def _draw_axis(axes: Axes, axis: Axis, along: str, tall: float) -> None:
    axes.set(xlim=(0.0, 1.0), ylim=(tall, 0.0))
    axes.set_xticks([axis.share(tick) for tick, _ in axis.ticks], [text for _, text in axis.ticks])
    framed(axes, along, "")
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    if axis.margins:
        band = axis.share(-EQUIVALENCE_MARGIN), axis.share(EQUIVALENCE_MARGIN)
        axes.axvspan(*band, color=SOFT, alpha=0.12, linewidth=0)
        red = PALETTE["fails"][0]
        axes.axvline(axis.share(FAIL_MARGIN), color=red, linewidth=0.9, linestyle=(0, (4, 3)))


def _draw_line(axes: Axes, canvas: Axes, line: Line, axis: Axis, y: float) -> None:
    """Name and number above, the marks below."""
    who = f"{line.row} → {line.cell}" if line.row else f"{line.cell} {line.note}".strip()
    behind = {"facecolor": PAPER, "edgecolor": "none", "pad": 0.6}
    middle = 0.06 + y + 0.5 * LINE_HEIGHT
    name = short(who, COLUMN - _EDGE - _RIGHT + 0.25)
    canvas.text(_EDGE, middle, name, va="center", bbox=behind, **TYPE)
    canvas.text(COLUMN - _EDGE, middle, line.number, va="center", ha="right", **TYPE)
    for mark in line.marks:
        _draw_mark(axes, mark, axis, y + (1.3 + 0.2 * mark.down) * LINE_HEIGHT)


def _draw_mark(axes: Axes, mark: Mark, axis: Axis, y: float) -> None:
    colour = PALETTE[mark.tone][0]
    if mark.value.bounded:
        low, high = (axis.share(end) for end in mark.value.ends)
        axes.plot([low, high], [y, y], color=colour, linewidth=1.1, solid_capstyle="butt")
        for end in (low, high):
            axes.plot([end, end], [y - _WHISKER, y + _WHISKER], color=colour, linewidth=0.8)
    face = colour if mark.filled else PAPER
    at = axis.share(mark.value.estimate)
    axes.plot(at, y, "o", color=colour, markerfacecolor=face, markersize=3.8, clip_on=False)


_LEFT, _GAP, _HEIGHT, _ABOVE, _BELOW = 0.5, 0.28, 1.0, 0.36, 0.42  # inches
_KEY: Final = 0.34  # inches of a line in the legend, with its gap
_TRUTH: Final[dict[str, Any]] = {"color": INK, "linewidth": 0.9, "linestyle": (0, (4, 3))}


def print_ladders(ladders: LadderPlots) -> Figure:
    """Plots in reading order under one legend; four across a page, two across a column."""
    plots = [(row, plot) for row, own in ladders.rows for plot in own]
    wide, across = (COLUMN, 2) if len(plots) <= 2 else (PAGE, 4)
    unit = (wide - _LEFT + _GAP - 0.08) / across
    legend = scheme_entries(ladders.schemes)
    if any(plot.truth is not None for _, plot in plots):
        legend.append(Entry("truth", _TRUTH))
    places = _legend_places(legend, wide)
    top = LINE_HEIGHT * (places[-1][1] + 1) + 0.06
    down = math.ceil(len(plots) / across)
    high = top + down * (_ABOVE + _HEIGHT + _BELOW)
    figure = blank_figure(wide, high)
    canvas = inch_canvas(figure)
    for entry, (x, line) in zip(legend, places, strict=True):
        _draw_entry(canvas, entry, x, 0.1 + LINE_HEIGHT * line)
    for number, (row, plot) in enumerate(plots):
        left = _LEFT + (number % across) * unit
        y = top + (number // across) * (_ABOVE + _HEIGHT + _BELOW)
        for line, words in enumerate((row, _about(plot))):
            said = short(words, unit - 0.08)
            canvas.text(left, y + (line + 0.7) * LINE_HEIGHT, said, va="center", **TYPE)
        axes = axes_at(figure, left, high - y - _ABOVE - _HEIGHT, unit - _GAP, _HEIGHT)
        letter = LETTER / (unit - _GAP)
        _draw_plot(axes, plot, "success" if number % across == 0 else "", letter)
    return figure


def _about(plot: LadderPlot) -> str:
    """What happens to the control period, shortly."""
    return plot.about.replace("control period", "control")


def _draw_plot(axes: Axes, plot: LadderPlot, up: str, letter: float) -> None:
    axes.set(ylim=(-0.05, 1.08), xlim=(-0.12, 1.12))
    words = [text if up else "" for _, text in RATE_AXIS.ticks]
    axes.set_yticks([tick for tick, _ in RATE_AXIS.ticks], words)
    ticks = thinned(plot.ticks, letter)
    axes.set_xticks([share for share, _ in ticks], [text for _, text in ticks])
    framed(axes, plot.along, up)
    if plot.truth is not None:
        axes.axhline(plot.truth.estimate, zorder=1.5, **_TRUTH)
    for series in plot.series:
        draw_series(axes, series, whisker=0.8, line=1.1, marker=0.7)


def _legend_places(entries: list[Entry], wide: float) -> list[tuple[float, int]]:
    """Left edge of every entry, inches, and its line."""
    places: list[tuple[float, int]] = []
    x, line = 0.08, 0
    for entry in entries:
        size = _KEY + LETTER * len(plain(entry.label, 26))
        if x + size > wide and places:
            x, line = 0.08, line + 1
        places.append((x, line))
        x += size + 0.1
    return places


def _draw_entry(canvas: Axes, entry: Entry, x: float, y: float) -> None:
    canvas.plot([x, x + 0.26], [y, y], **entry.line)
    if entry.marker is not None:
        smaller = {**entry.marker, "markersize": 0.7 * entry.marker["markersize"]}
        canvas.plot([x + 0.13], [y], linestyle="none", **smaller)
    canvas.text(x + _KEY - 0.04, y, plain(entry.label, 26), va="center", **TYPE)


_MATRIX_EDGE, _MATRIX_HEIGHT, _GROUP_GAP, _HEADS = 0.06, 0.31, 0.07, 0.86  # inches
_NARROWEST: Final = 0.29
"""Width of a column, inches."""

_LONGEST: Final = 1.7
"""Room for the name of a row, inches."""

Places: TypeAlias = dict[str, tuple[float, float]]
"""Name of a cell to the left edge and the width of its column, inches."""


def print_matrix(matrix: Matrix) -> Figure:
    """Numbers in coloured cells; what they mean in words below."""
    lines = [line for block in matrix.blocks for line in block.lines]
    left = _MATRIX_EDGE + LINE_HEIGHT + 0.1 + LETTER * max(len(_name(line)) for line in lines)
    places = _places(matrix, lines, left)
    right = max(x + width for x, width in places.values())
    wide = width_for(right + _MATRIX_EDGE)
    notes = _notes(matrix)
    top = _MATRIX_EDGE + _HEADS
    bottom = top + _MATRIX_HEIGHT * len(lines)
    figure = blank_figure(wide, bottom + 0.1 + LINE_HEIGHT * (1.2 + len(notes)))
    axes = inch_canvas(figure)
    for group in matrix.groups:
        _draw_head(axes, group, places, top)
    for number, line in enumerate(lines):
        _draw_row(axes, line, places, top + _MATRIX_HEIGHT * number, left)
    axes.text(
        (left + right) / 2.0, bottom + LINE_HEIGHT, "judged on (integrator above, step in s)",
        ha="center", va="center", **TYPE,
    )  # fmt: skip
    y = top
    for block in matrix.blocks:
        tall = _MATRIX_HEIGHT * len(block.lines)
        axes.text(
            _MATRIX_EDGE + 0.5 * LINE_HEIGHT, y + tall / 2.0, short(block.title, tall),
            ha="center", va="center", rotation=90, **TYPE,
        )  # fmt: skip
        y += tall
    for number, note in enumerate(notes):
        axes.text(_MATRIX_EDGE, bottom + LINE_HEIGHT * (number + 2.4), note, va="center", **TYPE)
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
    middle = y + _MATRIX_HEIGHT / 2.0
    axes.text(left - 0.05, middle, _name(line), ha="right", va="center", **TYPE)
    for _, shades in line.shades:
        for one, shade in shades:
            x, width = places[one.name]
            _draw_cell(axes, shade, (x, y, width))


def _draw_cell(axes: Axes, shade: Shade | None, at: tuple[float, float, float]) -> None:
    x, y, cell = at
    size = cell, _MATRIX_HEIGHT
    if shade is None:
        draw_box(axes, (x, y), size, 0.01, facecolor=SUNK, linewidth=0)
        axes.text(x + cell / 2.0, y + _MATRIX_HEIGHT / 2.0, NONE, ha="center", va="center", **TYPE)
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
        x + cell / 2.0, y + _MATRIX_HEIGHT / 2.0, text, ha="center", va="center", linespacing=0.95,
        bbox=behind, **{**TYPE, "color": ink},
    )  # fmt: skip
