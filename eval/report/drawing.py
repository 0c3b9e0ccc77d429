"""The figures beside a page, as PNG files."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final

from integ_gym.support.figures import (
    BOLD,
    INK,
    LINE,
    PALETTE,
    PAPER,
    SOFT,
    SUNK,
    Entry,
    axes_at,
    bare,
    blank_figure,
    draw_heading,
    draw_legend,
    fitting,
    inch_canvas,
    ink_on,
    legend_lines,
    line_style,
    marker_style,
    mixed,
    plain,
    scheme_entries,
    success_colour,
)
from integ_gym.support.terminal import NONE, step

from ..panel.result import Cell, Group
from ..verdict import EQUIVALENCE_MARGIN, FAIL_MARGIN
from .forests import Forest, Line, Mark
from .ladders import LadderPlot, LadderPlots, Series
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


_PITCH: Final = 0.3  # inches from line to line
_SPLIT: Final = 0.42  # of a block's heading
_LEFT, _WIDTH, _RIGHT, _TOP, _BOTTOM = 4.7, 4.4, 2.6, 0.8, 0.55
_WHISKER: Final = 0.05
_LONGEST: Final = 90  # letters that fit the left margin when they are smallest


def draw_forest(forest: Forest) -> Figure:
    """All blocks, one under the other, on one axis."""
    tall = sum(_SPLIT + _PITCH * len(block.lines) for block in forest.blocks)
    figure = blank_figure(_LEFT + _WIDTH + _RIGHT, _TOP + tall + _BOTTOM)
    axes = axes_at(figure, _LEFT, _BOTTOM, _WIDTH, tall)
    _draw_axis(axes, forest.axis, tall)
    canvas = inch_canvas(figure)
    draw_heading(canvas, 0.3, forest.title, forest.about)
    behind = {"facecolor": PAPER, "edgecolor": "none", "pad": 1.5}
    names = [_who(line) for block in forest.blocks for line in block.lines]
    size = fitting(names, _LEFT - 0.45, 8.5)
    y = 0.0
    for block in forest.blocks:
        y += _SPLIT
        heading = plain(block.title, 120)
        canvas.text(0.3, _TOP + y - 0.1, heading, size=9, color=INK, weight="bold", bbox=behind)
        for line in block.lines:
            _draw_line(axes, canvas, line, forest.axis, y + _PITCH / 2, size)
            y += _PITCH
    return figure


def _draw_axis(axes: Axes, axis: Axis, tall: float) -> None:
    axes.set(xlim=(0.0, 1.0), ylim=(tall, 0.0), yticks=[])
    axes.set_xticks([axis.share(tick) for tick, _ in axis.ticks], [text for _, text in axis.ticks])
    axes.grid(axis="x", color=LINE, linewidth=0.7)
    axes.set_axisbelow(True)
    bare(axes)
    if axis.low < 0.0:
        axes.axvline(axis.share(0.0), color=SOFT, linewidth=0.8)
    if axis.margins:
        band = axis.share(-EQUIVALENCE_MARGIN), axis.share(EQUIVALENCE_MARGIN)
        axes.axvspan(*band, color=INK, alpha=0.07, linewidth=0)
        margin, red = axis.share(FAIL_MARGIN), PALETTE["fails"][0]
        axes.axvline(margin, color=red, linewidth=1.2, linestyle=(0, (4, 3)))


def _draw_line(axes: Axes, canvas: Axes, line: Line, axis: Axis, y: float, size: float) -> None:
    for mark in line.marks:
        _draw_mark(axes, mark, axis, y + 0.5 * _PITCH * mark.down)
    down = _TOP + y
    canvas.text(_LEFT - 0.15, down, _who(line), size=size, color=INK, ha="right", va="center")
    right = _LEFT + _WIDTH + 0.15
    canvas.text(right, down, line.number, size=8.5, color=INK, va="center", weight="bold")
    canvas.text(right + 0.47, down, line.detail, size=8, color=SOFT, va="center")


def _who(line: Line) -> str:
    note = f" ({line.note})" if line.note else ""
    return plain((f"{line.row} → " if line.row else "") + line.cell + note, _LONGEST)


def _draw_mark(axes: Axes, mark: Mark, axis: Axis, y: float) -> None:
    colour = PALETTE[mark.tone][0]
    if mark.value.bounded:
        low, high = (axis.share(end) for end in mark.value.ends)
        axes.plot([low, high], [y, y], color=colour, linewidth=1.5, solid_capstyle="butt")
        for end in (low, high):
            axes.plot([end, end], [y - _WHISKER, y + _WHISKER], color=colour, linewidth=1.1)
    face = colour if mark.filled else PAPER
    at = axis.share(mark.value.estimate)
    axes.plot(at, y, "o", color=colour, markerfacecolor=face, markersize=5.5, clip_on=False)


_LADDER_WIDTH, _HEIGHT, _SIDE, _BELOW = 2.55, 1.75, 0.62, 1.02  # inches of a plot, and between two
_ASIDE = 0.011  # of the width, by which lines are moved
_TRUTH: Final[dict[str, Any]] = {"color": INK, "linewidth": 1.3, "linestyle": (0, (4, 3))}


def draw_ladders(ladders: LadderPlots) -> Figure:
    """Every row's plots side by side, two rows across."""
    across = 2 if len(ladders.rows) > 1 else 1
    down = math.ceil(len(ladders.rows) / across)
    unit = (2 if ladders.paired else 1) * (_LADDER_WIDTH + _SIDE) + 0.3
    wide = max(0.3 + across * unit, 6.9)
    legend = scheme_entries(ladders.schemes)
    if any(plot.truth is not None for _, plots in ladders.rows for plot in plots):
        legend.append(Entry("truth", _TRUTH))
    top = 1.3 + 0.2 * legend_lines(legend, wide)
    high = top + down * (_HEIGHT + _BELOW) + 0.1
    figure = blank_figure(wide, high)
    canvas = inch_canvas(figure)
    draw_heading(canvas, 0.3, ladders.title, ladders.about)
    draw_legend(canvas, legend, wide)
    for number, (row, plots) in enumerate(ladders.rows):
        x = 0.3 + (number % across) * unit
        y = top + (number // across) * (_HEIGHT + _BELOW)
        canvas.text(x, y - 0.02, plain(row), size=10, color=INK, weight="bold")
        for place, plot in enumerate(plots):
            left = x + 0.42 + place * (_LADDER_WIDTH + _SIDE)
            axes = axes_at(figure, left, high - y - 0.32 - _HEIGHT, _LADDER_WIDTH, _HEIGHT)
            _draw_plot(axes, plot)
    return figure


def _draw_plot(axes: Axes, plot: LadderPlot) -> None:
    axes.set(ylim=(-0.04, 1.06), xlim=(-0.15, 1.15))
    axes.set_yticks([tick for tick, _ in RATE_AXIS.ticks], [text for _, text in RATE_AXIS.ticks])
    axes.set_xticks([share for share, _ in plot.ticks], [text for _, text in plot.ticks])
    axes.grid(axis="y", color=LINE, linewidth=0.7)
    axes.set_axisbelow(True)
    axes.set_title(plot.about, size=8, color=SOFT, loc="left", pad=3)
    axes.set_xlabel(plot.along, size=8, color=SOFT, labelpad=1)
    bare(axes)
    if plot.truth is not None:
        axes.axhline(plot.truth.estimate, zorder=1.5, **_TRUTH)
    for series in plot.series:
        draw_series(axes, series)


def draw_series(
    axes: Axes, series: Series, *, whisker: float = 1.1, line: float = 1.6, marker: float = 1.0
) -> None:
    """One row's rates over the steps, with their intervals.

    Args:
        axes: of a plot.
        series: the row.
        whisker, line: widths, points.
        marker: factor on the size of markers.
    """
    xs = [point.x + _ASIDE * series.aside for point in series.points]
    for x, point in zip(xs, series.points, strict=True):
        axes.plot(
            [x, x], point.value.ends, color=series.style.colour, linewidth=whisker, alpha=0.45
        )
    rates = [point.value.estimate for point in series.points]
    style = {**line_style(series.style, line), **marker_style(series.style)}
    axes.plot(xs, rates, clip_on=False, **{**style, "markersize": marker * style["markersize"]})


WIDTH, HEIGHT = 0.62, 0.46  # inches of a cell
_MATRIX_LEFT, _MATRIX_TOP = 2.75, 1.62
_GROUP_GAP: Final = 0.14  # inches between groups of columns
_TRUTH_GAP: Final = 0.34
_HATCHES: Final = {"too_slow": "////", "unachievable": "xxxx"}
_STRIPES: Final = 0.45  # share of the ink in a hatching's colour
_LEGEND_LINE: Final = 0.24  # inches
_BLOCK_GAP: Final = 0.36  # inches between blocks of rows, where their heading stands


def draw_matrix(matrix: Matrix) -> Figure:
    """A matrix with its legend."""
    columns, right = _column_places(matrix.groups)
    rows = [line for block in matrix.blocks for line in block.lines]
    bottom = _MATRIX_TOP + HEIGHT * len(rows) + _BLOCK_GAP * (len(matrix.blocks) - 1)
    lines = len(_notes(matrix)) + len(matrix.hatchings)
    figure = blank_figure(max(right + 0.35, 7.2), bottom + 0.6 + _LEGEND_LINE * lines)
    axes = inch_canvas(figure)
    draw_heading(axes, 0.3, matrix.title, matrix.about)
    _column_heads(axes, matrix, columns, bottom)
    y = _MATRIX_TOP
    for block in matrix.blocks:
        axes.text(0.3, y - 0.1, block.title, size=8.5, color=SOFT, va="baseline")
        for line in block.lines:
            _draw_row(axes, line, columns, y)
            y += HEIGHT
        y += _BLOCK_GAP
    _legend(axes, matrix, bottom + 0.3)
    return figure


def _draw_row(axes: Axes, line: MatrixLine, columns: dict[str, float], y: float) -> None:
    name = plain(line.name, 38)
    axes.text(
        _MATRIX_LEFT - 0.14, y + HEIGHT / 2, name, size=fitting([name], _MATRIX_LEFT - 0.44, 9.0),
        color=INK, ha="right", va="center", weight="bold",
    )  # fmt: skip
    for _, shades in line.shades:
        for cell, shade in shades:
            x = columns[cell.name]
            if shade is None:
                _box(axes, x, y, facecolor=SUNK, linewidth=0)
                _cell_text(axes, x, y, NONE, SOFT)
            else:
                _draw_shade(axes, x, y, shade)


def _draw_shade(axes: Axes, x: float, y: float, shade: Shade) -> None:
    colour = shade_colour(shade)
    ink = SOFT if shade.tone == "empty" else ink_on(colour)
    _box(axes, x, y, facecolor=colour, linewidth=0)
    if shade.hatched:
        _box(axes, x, y, linewidth=0, **stripes(shade.hatched, colour, ink))
    if shade.home:
        _box(axes, x, y, 0.03, fill=False, edgecolor=PAPER, linewidth=2.6)
        _box(axes, x, y, 0.008, fill=False, edgecolor=INK, linewidth=1.9)
    size = 6.8 if len(shade.text) > 7 else 9.0
    behind = {"facecolor": colour, "edgecolor": "none", "pad": 1.2} if shade.hatched else None
    _cell_text(axes, x, y, shade.text, ink, size, 0.05 if shade.marks else 0.0, behind)
    if shade.marks:
        _cell_text(axes, x, y, " ".join(shade.marks), ink, 6.5, -0.13, behind)


def stripes(hatched: str, ground: str, ink: str) -> dict[str, Any]:
    """Properties of a hatched rectangle, as Matplotlib takes them."""
    colour = mixed(ground, ink, _STRIPES)
    return {"facecolor": ground, "edgecolor": colour, "hatch": _HATCHES[hatched]}


def shade_colour(shade: Shade) -> str:
    """The ground of a cell."""
    return SUNK if shade.tone == "empty" else _colour(shade.tone, shade.share)


def _colour(tone: str, share: float) -> str:
    """A colour of the scale of rates, or one thinned with the paper's."""
    return success_colour(share) if tone == "rate" else mixed(PAPER, PALETTE[tone][0], share)


def _legend(axes: Axes, matrix: Matrix, y: float) -> None:
    def signed(share: float) -> str:
        return _colour("warm" if share > 0.5 else "cool", abs(2.0 * share - 1.0))

    low, high = matrix.ends
    x = _MATRIX_LEFT + 0.07 * len(low) + 0.08
    _small(axes, _MATRIX_LEFT, y, low)
    _ramp(axes, x, y - 0.065, signed if matrix.signed else success_colour)
    _small(axes, x + 1.18, y, high)
    x += 1.38 + 0.07 * len(high)
    _rectangle(axes, x, y - 0.07, 0.2, 0.14, fill=False, edgecolor=INK, linewidth=1.6)
    _small(axes, x + 0.28, y, "trained here")
    for note in _notes(matrix):
        y += _LEGEND_LINE
        _small(axes, _MATRIX_LEFT, y, plain(note, 80))
    for hatched, words in matrix.hatchings:
        y += _LEGEND_LINE
        hatching = stripes(hatched, SUNK, INK)
        _rectangle(axes, _MATRIX_LEFT, y - 0.08, 0.3, 0.16, linewidth=0, **hatching)
        _small(axes, _MATRIX_LEFT + 0.38, y, plain(words, 80))


def _notes(matrix: Matrix) -> list[str]:
    """What the legend says, by line."""
    lines = "     ".join(matrix.notes[:-1]), matrix.notes[-1]
    return [line for line in lines if line]


def _rectangle(axes: Axes, x: float, y: float, width: float, height: float, **style: Any) -> None:
    from matplotlib.patches import Rectangle

    axes.add_patch(Rectangle((x, y), width, height, **style))


def _box(axes: Axes, x: float, y: float, gap: float = 0.02, **style: Any) -> None:
    """A rectangle in a cell, with a gap to its edges."""
    draw_box(axes, (x, y), (WIDTH, HEIGHT), gap, **style)


def draw_box(
    axes: Axes, corner: tuple[float, float], size: tuple[float, float], gap: float, **style: Any
) -> None:
    """A rectangle in a cell of a size, with a gap to its edges, inches."""
    (x, y), (width, height) = corner, size
    _rectangle(axes, x + gap, y + gap, width - 2 * gap, height - 2 * gap, **style)


def _cell_text(
    axes: Axes,
    x: float,
    y: float,
    text: str,
    colour: str,
    size: float = 9.0,
    up: float = 0.0,
    behind: dict[str, Any] | None = None,
) -> None:
    """A text in the middle, moved by ``up`` inches, on a patch ``behind`` it if one is given."""
    axes.text(
        x + WIDTH / 2, y + HEIGHT / 2 - up, text, size=size, color=colour, ha="center",
        va="center_baseline" if up else "center", bbox=behind,
    )  # fmt: skip


def _ramp(axes: Axes, x: float, y: float, colour: Callable[[float], str]) -> None:
    """A colour scale one inch wide; ``colour`` takes shares in [0, 1]."""
    parts = 60
    for part in range(parts):
        shade = colour((part + 0.5) / parts)
        _rectangle(axes, x + part / parts, y, 1.1 / parts, 0.13, facecolor=shade, linewidth=0)


def _small(axes: Axes, x: float, y: float, text: str) -> None:
    axes.text(x, y, text, size=8, color=SOFT, ha="left", va="center")


def _column_places(groups: Sequence[Group]) -> tuple[dict[str, float], float]:
    """Left edge of every column in inches, and what lies to the right of the last."""
    places: dict[str, float] = {}
    x = _MATRIX_LEFT
    for group in groups:
        for cell in group.cells:
            places[cell.name] = x
            x += WIDTH
        x += _TRUTH_GAP if group.reference else _GROUP_GAP
    return places, x


def _column_heads(axes: Axes, matrix: Matrix, place: dict[str, float], bottom: float) -> None:
    """Names of integrators over their steps."""
    groups = matrix.groups
    widths = [len(group.cells) * WIDTH + 0.1 for group in groups]
    names = ["truth" if group.reference else group.label for group in groups]
    heads = [_head(name, width) for name, width in zip(names, widths, strict=True)]
    size = min(fitting(head, width, 9.5) for head, width in zip(heads, widths, strict=True))
    for group, lines in zip(groups, heads, strict=True):
        first, last = place[group.cells[0].name], place[group.cells[-1].name] + WIDTH
        axes.text(
            (first + last) / 2, _MATRIX_TOP - 0.62, "\n".join(lines), color=INK, ha="center",
            size=size, weight="bold", va="bottom", linespacing=1.0,
        )  # fmt: skip
        if group.reference:
            edge = last + _TRUTH_GAP / 2
            axes.plot([edge, edge], [_MATRIX_TOP - 0.75, bottom], color=INK, linewidth=1.2)
        else:
            ends = [first + 0.05, last - 0.05]
            axes.plot(ends, [_MATRIX_TOP - 0.54] * 2, color=LINE, linewidth=1)
        for cell in group.cells:
            _column_head(axes, cell, place[cell.name] + WIDTH / 2, matrix.periods)


def _head(label: str, width: float) -> list[str]:
    """A group's name on one line, or cut after underscores and spaces into two where narrow."""
    most = int(width / (BOLD * 6.5))
    text = plain(label, max(2 * most, 8))
    if len(text) * BOLD * 9.5 <= width:
        return [text]
    cuts = [place + 1 for place, letter in enumerate(text[:-1]) if letter in "_ "]
    cut = min(cuts, key=lambda place: abs(place - len(text) / 2), default=len(text))
    return [line.strip() for line in (text[:cut], text[cut:]) if line.strip()]


def _column_head(axes: Axes, cell: Cell, x: float, periods: bool) -> None:
    text = "reference" if cell.reference else step(cell.dt)
    axes.text(x, _MATRIX_TOP - 0.36, text, size=7.5, color=SOFT, ha="center", va="baseline")
    if periods:
        period = f"every {step(cell.control_period)}"
        axes.text(x, _MATRIX_TOP - 0.22, period, size=6.5, color=SOFT, ha="center", va="baseline")
