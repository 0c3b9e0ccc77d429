"""How figures are drawn beside a page; papers share marks, series and shades."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final

from integ_gym.support import figures
from integ_gym.support.terminal import NONE, step

from ..panel.result import Group
from ..verdict import EQUIVALENCE_MARGIN, FAIL_MARGIN
from .forests import RATE_AXIS, Axis, Forest, Line
from .ladders import LadderPlot, LadderPlots
from .matrices import Matrix, MatrixLine, Shade

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
    figure = figures.blank_figure(_LEFT + _WIDTH + _RIGHT, _TOP + tall + _BOTTOM)
    axes = figures.axes_at(figure, _LEFT, _BOTTOM, _WIDTH, tall)
    draw_axis(axes, forest.axis, tall)
    axes.grid(axis="x", color=figures.LINE, linewidth=0.7)
    axes.set_axisbelow(True)
    figures.bare(axes)
    if forest.axis.low < 0.0:
        axes.axvline(forest.axis.share(0.0), color=figures.SOFT, linewidth=0.8)
    canvas = figures.inch_canvas(figure)
    figures.draw_heading(canvas, 0.3, forest.title, forest.about)
    behind = {"facecolor": figures.PAPER, "edgecolor": "none", "pad": 1.5}
    size = figures.fitting(
        [_who(x) for block in forest.blocks for x in block.lines], _LEFT - 0.45, 8.5
    )
    right, y = _LEFT + _WIDTH + 0.15, 0.0
    for block in forest.blocks:
        y += _SPLIT
        heading = figures.plain(block.title, 120)
        canvas.text(
            0.3, _TOP + y - 0.1, heading, size=9, color=figures.INK, weight="bold", bbox=behind
        )
        for line in block.lines:
            middle = y + _PITCH / 2
            draw_marks(axes, line, forest.axis, middle, 0.5 * _PITCH)
            texts: list[tuple[float, str, dict[str, Any]]] = [
                (_LEFT - 0.15, _who(line), {"size": size, "color": figures.INK, "ha": "right"}),
                (right, line.number, {"size": 8.5, "color": figures.INK, "weight": "bold"}),
                (right + 0.47, line.detail, {"size": 8, "color": figures.SOFT}),
            ]
            for x, text, style in texts:
                canvas.text(x, _TOP + middle, text, va="center", **style)
            y += _PITCH
    return figure


def _who(line: Line) -> str:
    note = f" ({line.note})" if line.note else ""
    return figures.plain((f"{line.row} → " if line.row else "") + line.cell + note, _LONGEST)


def draw_axis(axes: Axes, axis: Axis, tall: float, scale: float = 1.0) -> None:
    """Ticks and margins of a forest; the unit downwards is one inch.

    Args:
        axes: of the forest.
        axis: what they show.
        tall: height, inches.
        scale: factor on widths of lines.
    """
    axes.set(xlim=(0.0, 1.0), ylim=(tall, 0.0), yticks=[])
    axes.set_xticks([axis.share(tick) for tick, _ in axis.ticks], [text for _, text in axis.ticks])
    if axis.margins:
        band = axis.share(-EQUIVALENCE_MARGIN), axis.share(EQUIVALENCE_MARGIN)
        axes.axvspan(*band, color=figures.INK, alpha=0.07, linewidth=0)
        margin, red = axis.share(FAIL_MARGIN), figures.PALETTE["fails"][0]
        axes.axvline(margin, color=red, linewidth=1.2 * scale, linestyle=(0, (4, 3)))


def draw_marks(
    axes: Axes, line: Line, axis: Axis, y: float, reach: float, scale: float = 1.0
) -> None:
    """Marks of a line, ``reach`` above and below ``y``, inches."""
    for mark in line.marks:
        colour, down = figures.PALETTE[mark.tone][0], y + reach * mark.down
        if mark.value.bounded:
            low, high = (axis.share(end) for end in mark.value.ends)
            axes.plot(
                [low, high], [down, down], color=colour, linewidth=1.5 * scale,
                solid_capstyle="butt",
            )  # fmt: skip
            cap = [down - _WHISKER * scale, down + _WHISKER * scale]
            for end in (low, high):
                axes.plot([end, end], cap, color=colour, linewidth=1.1 * scale)
        axes.plot(
            axis.share(mark.value.estimate), down, "o", color=colour, markersize=5.5 * scale,
            markerfacecolor=colour if mark.filled else figures.PAPER, clip_on=False,
        )  # fmt: skip


_LADDER_WIDTH, _HEIGHT, _SIDE, _BELOW = 2.55, 1.75, 0.62, 1.02  # inches of a plot, and between two
_ASIDE = 0.011  # of the width, by which lines are moved


def draw_ladders(ladders: LadderPlots) -> Figure:
    """Every row's plots side by side, two rows across."""
    across = 2 if len(ladders.rows) > 1 else 1
    unit = (2 if ladders.paired else 1) * (_LADDER_WIDTH + _SIDE) + 0.3
    wide = max(0.3 + across * unit, 6.9)
    legend = ladder_entries(ladders)
    top = 1.3 + 0.2 * figures.legend_lines(legend, wide)
    high = top + math.ceil(len(ladders.rows) / across) * (_HEIGHT + _BELOW) + 0.1
    figure = figures.blank_figure(wide, high)
    canvas = figures.inch_canvas(figure)
    figures.draw_heading(canvas, 0.3, ladders.title, ladders.about)
    figures.draw_legend(canvas, legend, wide)
    for number, (row, plots) in enumerate(ladders.rows):
        x = 0.3 + (number % across) * unit
        y = top + (number // across) * (_HEIGHT + _BELOW)
        canvas.text(x, y - 0.02, figures.plain(row), size=10, color=figures.INK, weight="bold")
        for place, plot in enumerate(plots):
            left = x + 0.42 + place * (_LADDER_WIDTH + _SIDE)
            axes = figures.axes_at(figure, left, high - y - 0.32 - _HEIGHT, _LADDER_WIDTH, _HEIGHT)
            axes.set(ylim=(-0.04, 1.06), xlim=(-0.15, 1.15))
            axes.set_yticks(
                [at for at, _ in RATE_AXIS.ticks], [text for _, text in RATE_AXIS.ticks]
            )
            axes.set_xticks([share for share, _ in plot.ticks], [text for _, text in plot.ticks])
            axes.grid(axis="y", color=figures.LINE, linewidth=0.7)
            axes.set_axisbelow(True)
            axes.set_title(plot.about, size=8, color=figures.SOFT, loc="left", pad=3)
            axes.set_xlabel(plot.along, size=8, color=figures.SOFT, labelpad=1)
            figures.bare(axes)
            draw_series(axes, plot)
    return figure


def ladder_entries(ladders: LadderPlots, scale: float = 1.0) -> list[figures.Entry]:
    """Of the legend: the series, and the truth where a plot has it."""
    truth = any(plot.truth is not None for _, plots in ladders.rows for plot in plots)
    return figures.scheme_entries(ladders.schemes) + (
        [figures.Entry(ladders.truth_name, _truth(scale))] if truth else []
    )


def _truth(scale: float) -> dict[str, Any]:
    return {"color": figures.INK, "linewidth": 1.3 * scale, "linestyle": (0, (4, 3))}


def draw_series(axes: Axes, plot: LadderPlot, scale: float = 1.0) -> None:
    """The rates of a plot over the steps, with their intervals, and the truth.

    Args:
        axes: of the plot.
        plot: what it shows.
        scale: factor on lines and markers.
    """
    if plot.truth is not None:
        axes.axhline(plot.truth.estimate, zorder=1.5, **_truth(scale))
    for series in plot.series:
        xs = [point.x + _ASIDE * series.aside for point in series.points]
        for x, point in zip(xs, series.points, strict=True):
            axes.plot(
                [x, x], point.value.ends, color=series.style.colour, linewidth=1.1 * scale,
                alpha=0.45,
            )  # fmt: skip
        rates = [point.value.estimate for point in series.points]
        style = {
            **figures.line_style(series.style, 1.6 * scale),
            **figures.marker_style(series.style),
        }
        style["markersize"] *= scale
        axes.plot(xs, rates, clip_on=False, **style)


_CELL_WIDTH, _CELL_HEIGHT = 0.62, 0.46  # inches
_MATRIX_LEFT, _MATRIX_TOP = 2.75, 1.62
_GROUP_GAP, _TRUTH_GAP = 0.14, 0.34  # inches between groups of columns
_HATCHES: Final = {"too_slow": "////", "unachievable": "xxxx"}
_STRIPES: Final = 0.45  # share of the ink in a hatching's colour
_LEGEND_LINE: Final = 0.24  # inches
_BLOCK_GAP: Final = 0.36  # inches between blocks of rows, where their heading stands


def draw_matrix(matrix: Matrix) -> Figure:
    """A matrix with its legend."""
    columns, right = {}, _MATRIX_LEFT
    for group in matrix.groups:
        for cell in group.cells:
            columns[cell.name] = right
            right += _CELL_WIDTH
        right += _TRUTH_GAP if group.reference else _GROUP_GAP
    notes = [note for note in ("     ".join(matrix.notes[:-1]), *matrix.notes[-1:]) if note]
    rows = sum(len(block.lines) for block in matrix.blocks)
    bottom = _MATRIX_TOP + _CELL_HEIGHT * rows + _BLOCK_GAP * (len(matrix.blocks) - 1)
    lines = len(notes) + len(matrix.hatchings)
    figure = figures.blank_figure(max(right + 0.35, 7.2), bottom + 0.6 + _LEGEND_LINE * lines)
    axes = figures.inch_canvas(figure)
    figures.draw_heading(axes, 0.3, matrix.title, matrix.about)
    _draw_column_heads(axes, matrix, columns, bottom)
    y = _MATRIX_TOP
    for block in matrix.blocks:
        axes.text(0.3, y - 0.1, block.title, size=8.5, color=figures.SOFT, va="baseline")
        for line in block.lines:
            _draw_row(axes, line, columns, y)
            y += _CELL_HEIGHT
        y += _BLOCK_GAP
    _draw_matrix_legend(axes, matrix, notes, bottom + 0.3)
    return figure


def _draw_row(axes: Axes, line: MatrixLine, columns: dict[str, float], y: float) -> None:
    name = figures.plain(line.name, 38)
    axes.text(
        _MATRIX_LEFT - 0.14, y + _CELL_HEIGHT / 2, name, ha="right", va="center", weight="bold",
        size=figures.fitting([name], _MATRIX_LEFT - 0.44, 9.0), color=figures.INK,
    )  # fmt: skip
    for cell, shade in line.shades.items():
        x, size = columns[cell], (_CELL_WIDTH, _CELL_HEIGHT)
        ink, behind = draw_shade(axes, shade, (x, y), size, 0.02, 1.2)
        if shade is not None and shade.home:
            draw_box(axes, (x, y), size, 0.03, fill=False, edgecolor=figures.PAPER, linewidth=2.6)
            draw_box(axes, (x, y), size, 0.008, fill=False, edgecolor=figures.INK, linewidth=1.9)
        marks = " ".join(shade.marks) if shade else ""
        text = shade.text if shade else NONE
        up = 0.05 if marks else 0.0
        for words, points, above in (
            (text, 6.8 if len(text) > 7 else 9.0, up),
            (marks, 6.5, -0.13),
        ):
            if words:
                axes.text(
                    x + _CELL_WIDTH / 2, y + _CELL_HEIGHT / 2 - above, words, size=points,
                    color=ink, ha="center", va="center_baseline" if above else "center",
                    bbox=behind,
                )  # fmt: skip


def draw_shade(
    axes: Axes,
    shade: Shade | None,
    corner: tuple[float, float],
    size: tuple[float, float],
    gap: float,
    pad: float,
) -> tuple[str, dict[str, Any] | None]:
    """The ground of a cell, hatched where it is; returns the colour of text and what is behind it.

    Args:
        axes: inches, y downwards.
        shade: what the cell shows; None where a row was not evaluated.
        corner, size: of the cell.
        gap: to its edges.
        pad: around a text on a hatching, points.
    """
    colour = (
        figures.SUNK if shade is None or shade.tone == "empty" else _tone(shade.tone, shade.share)
    )
    ink = figures.SOFT if shade is None or shade.tone == "empty" else figures.ink_on(colour)
    draw_box(axes, corner, size, gap, facecolor=colour, linewidth=0)
    if shade is None or not shade.hatched:
        return ink, None
    draw_box(axes, corner, size, gap, linewidth=0, **_stripes(shade.hatched, colour, ink))
    return ink, {"facecolor": colour, "edgecolor": "none", "pad": pad}


def draw_box(
    axes: Axes, corner: tuple[float, float], size: tuple[float, float], gap: float, **style: Any
) -> None:
    """A rectangle in a cell of a size, with a gap to its edges, inches."""
    from matplotlib.patches import Rectangle

    (x, y), (width, height) = corner, size
    axes.add_patch(Rectangle((x + gap, y + gap), width - 2 * gap, height - 2 * gap, **style))


def _stripes(hatched: str, ground: str, ink: str) -> dict[str, Any]:
    """Properties of a hatched rectangle, as Matplotlib takes them."""
    colour = figures.mixed(ground, ink, _STRIPES)
    return {"facecolor": ground, "edgecolor": colour, "hatch": _HATCHES[hatched]}


def _tone(tone: str, share: float) -> str:
    """A colour of the scale of rates, or one thinned with the paper's."""
    return (
        figures.success_colour(share)
        if tone == "rate"
        else figures.mixed(figures.PAPER, figures.PALETTE[tone][0], share)
    )


def _draw_matrix_legend(axes: Axes, matrix: Matrix, notes: Sequence[str], y: float) -> None:
    def small(x: float, y: float, text: str) -> None:
        axes.text(x, y, text, size=8, color=figures.SOFT, ha="left", va="center")

    def signed(share: float) -> str:
        return _tone("warm" if share > 0.5 else "cool", abs(2.0 * share - 1.0))

    low, high = matrix.ends
    x, parts = _MATRIX_LEFT + 0.07 * len(low) + 0.08, 60
    small(_MATRIX_LEFT, y, low)
    colour: Callable[[float], str] = signed if matrix.signed else figures.success_colour
    for part in range(parts):
        place, shade = (x + part / parts, y - 0.065), colour((part + 0.5) / parts)
        draw_box(axes, place, (1.1 / parts, 0.13), 0.0, facecolor=shade, linewidth=0)
    small(x + 1.18, y, high)
    x += 1.38 + 0.07 * len(high)
    draw_box(
        axes, (x, y - 0.07), (0.2, 0.14), 0.0, fill=False, edgecolor=figures.INK, linewidth=1.6
    )
    small(x + 0.28, y, "trained here")
    for note in notes:
        y += _LEGEND_LINE
        small(_MATRIX_LEFT, y, figures.plain(note, 80))
    for hatched, words in matrix.hatchings:
        y += _LEGEND_LINE
        hatching = _stripes(hatched, figures.SUNK, figures.INK)
        draw_box(axes, (_MATRIX_LEFT, y - 0.08), (0.3, 0.16), 0.0, linewidth=0, **hatching)
        small(_MATRIX_LEFT + 0.38, y, figures.plain(words, 80))


def _draw_column_heads(
    axes: Axes, matrix: Matrix, columns: dict[str, float], bottom: float
) -> None:
    """Names of integrators over their steps."""
    heads, size = [_head(group) for group in matrix.groups], 9.5
    for group, lines in zip(matrix.groups, heads, strict=True):
        size = min(size, figures.fitting(lines, len(group.cells) * _CELL_WIDTH + 0.1, 9.5))
    for group, lines in zip(matrix.groups, heads, strict=True):
        first, last = columns[group.cells[0].name], columns[group.cells[-1].name] + _CELL_WIDTH
        axes.text(
            (first + last) / 2, _MATRIX_TOP - 0.62, "\n".join(lines), size=size, ha="center",
            color=figures.INK, weight="bold", va="bottom", linespacing=1.0,
        )  # fmt: skip
        if group.reference:
            edge = last + _TRUTH_GAP / 2
            axes.plot([edge, edge], [_MATRIX_TOP - 0.75, bottom], color=figures.INK, linewidth=1.2)
        else:
            ends = [first + 0.05, last - 0.05]
            axes.plot(ends, [_MATRIX_TOP - 0.54] * 2, color=figures.LINE, linewidth=1)
        for cell in group.cells:
            texts = [("reference" if cell.reference else step(cell.dt), 0.36, 7.5)]
            texts += [(f"every {step(cell.control_period)}", 0.22, 6.5)] * matrix.periods
            for text, up, points in texts:
                axes.text(
                    columns[cell.name] + _CELL_WIDTH / 2, _MATRIX_TOP - up, text, size=points,
                    color=figures.SOFT, ha="center", va="baseline",
                )  # fmt: skip


def _head(group: Group) -> list[str]:
    """A group's name on one line, or cut after underscores and spaces into two where narrow."""
    width = len(group.cells) * _CELL_WIDTH + 0.1
    most = int(width / (figures.BOLD * 6.5))
    text = figures.plain(group.label, max(2 * most, 8))
    if len(text) * figures.BOLD * 9.5 <= width:
        return [text]
    cuts = [place + 1 for place, letter in enumerate(text[:-1]) if letter in "_ "]
    cut = min(cuts, key=lambda place: abs(place - len(text) / 2), default=len(text))
    return [line.strip() for line in (text[:cut], text[cut:]) if line.strip()]
