"""The figures of a panel, written as files: as beside a page, or as papers print them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from integ_gym.support import figures
from integ_gym.support.optional import load
from integ_gym.support.terminal import NONE, step

from ..panel.result import Panel
from . import drawing, forests
from .ladders import LadderPlots, ladder_plots, sweep_plots, thin_ticks
from .matrices import Matrix, MatrixLine, Shade, energy_matrix, return_matrix, success_matrix

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


COLUMN: Final = 3.35
"""Width of a column, inches: what IEEE, ACM and Elsevier have, to within 0.2."""

PAGE: Final = 6.9
"""Width of both columns of a page, inches."""

SIZE: Final = 8.0
"""Of all type, points."""

_LETTER: Final = 0.063
"""Width of a letter of that size, inches."""

_LINE: Final = 0.155
"""Inches from line to line of type."""

_TYPE: Final[dict[str, Any]] = {"size": SIZE, "color": figures.INK}
_SCALE: Final = 0.7
"""Of lines and markers, to those beside a page."""


def _short(name: str, room: float) -> str:
    """Names of rows and cells with no more than they need, cut to a width in inches."""
    return figures.plain(name.replace(" dt=", " "), int(room / _LETTER))


def _label(axes: Axes, across: str, up: str) -> None:
    """Label axes; with ticks, and without a frame above and at the right."""
    axes.set_xlabel(across, labelpad=2, **_TYPE)
    axes.set_ylabel(up, labelpad=2, **_TYPE)
    axes.tick_params(labelsize=SIZE, colors=figures.INK, length=2.5, width=0.6, pad=2)
    axes.set_facecolor("none")
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set(color=figures.INK, linewidth=0.6)
    axes.grid(color=figures.LINE, linewidth=0.5)
    axes.set_axisbelow(True)


_PITCH, _HEADING = 1.7 * _LINE, 1.5 * _LINE
_EDGE, _RIGHT, _BOTTOM = 0.12, 0.5, 0.4


def print_forest(forest: forests.Forest) -> Figure:
    """All blocks, one under the other, on one axis; names and numbers above their marks."""
    tall = sum(_HEADING + _PITCH * len(block.lines) for block in forest.blocks)
    figure = figures.blank_figure(COLUMN, tall + _BOTTOM + 0.06)
    axes = figures.axes_at(figure, _EDGE, _BOTTOM, COLUMN - _EDGE - _RIGHT, tall)
    drawing.draw_axis(axes, forest.axis, tall, _SCALE)
    _label(axes, forest.along, "")
    axes.spines["left"].set_visible(False)
    canvas = figures.inch_canvas(figure)
    behind = {"facecolor": figures.PAPER, "edgecolor": "none", "pad": 0.6}
    y = 0.0
    for block in forest.blocks:
        heading = _short(block.title, COLUMN - 2 * _EDGE)
        canvas.text(_EDGE, 0.06 + y + 0.6 * _HEADING, heading, va="center", weight="bold", **_TYPE)
        y += _HEADING
        for line in block.lines:
            who = f"{line.row} → {line.cell}" if line.row else f"{line.cell} {line.note}".strip()
            name, middle = _short(who, COLUMN - _EDGE - _RIGHT + 0.25), 0.06 + y + 0.5 * _LINE
            canvas.text(_EDGE, middle, name, va="center", bbox=behind, **_TYPE)
            canvas.text(COLUMN - _EDGE, middle, line.number, va="center", ha="right", **_TYPE)
            drawing.draw_marks(axes, line, forest.axis, y + 1.3 * _LINE, 0.2 * _LINE, _SCALE)
            y += _PITCH
    return figure


_LEFT, _GAP, _HEIGHT, _ABOVE, _BELOW = 0.5, 0.28, 1.0, 0.36, 0.42  # inches
_LEGEND: Final = {"left": 0.08, "gap": 0.07}


def print_ladders(ladders: LadderPlots) -> Figure:
    """Plots in reading order under one legend; four across a page, two across a column."""
    plots = [(row, plot) for row, own in ladders.rows for plot in own]
    wide, across = (COLUMN, 2) if len(plots) <= 2 else (PAGE, 4)
    unit = (wide - _LEFT + _GAP - 0.08) / across
    legend = drawing.ladder_entries(ladders, _SCALE)
    top = _LINE * figures.legend_lines(legend, wide, **_LEGEND) + 0.06
    high = top + math.ceil(len(plots) / across) * (_ABOVE + _HEIGHT + _BELOW)
    figure = figures.blank_figure(wide, high)
    canvas = figures.inch_canvas(figure)
    figures.draw_legend(canvas, legend, wide, 0.1, pitch=_LINE, scale=_SCALE, **_LEGEND)
    for number, (row, plot) in enumerate(plots):
        left = _LEFT + (number % across) * unit
        y = top + (number // across) * (_ABOVE + _HEIGHT + _BELOW)
        about = plot.about.replace("control period", "control")
        for line, words in enumerate((row, about)):
            middle = y + (line + 0.7) * _LINE
            canvas.text(left, middle, _short(words, unit - 0.08), va="center", **_TYPE)
        axes = figures.axes_at(figure, left, high - y - _ABOVE - _HEIGHT, unit - _GAP, _HEIGHT)
        axes.set(ylim=(-0.05, 1.08), xlim=(-0.12, 1.12))
        first = number % across == 0
        rates = [text if first else "" for _, text in forests.RATE_AXIS.ticks]
        axes.set_yticks([tick for tick, _ in forests.RATE_AXIS.ticks], rates)
        ticks = thin_ticks(plot.ticks, _LETTER / (unit - _GAP))
        axes.set_xticks([share for share, _ in ticks], [text for _, text in ticks])
        _label(axes, plot.along, "success" if first else "")
        drawing.draw_series(axes, plot, _SCALE)
    return figure


_MATRIX_EDGE, _MATRIX_HEIGHT, _GROUP_GAP, _HEADS = 0.06, 0.31, 0.07, 0.86  # inches
_NARROWEST: Final = 0.29
"""Width of a column, inches."""

_LONGEST: Final = 1.7
"""Room for the name of a row, inches."""


def print_matrix(matrix: Matrix) -> Figure:
    """Numbers in coloured cells; what they mean in words below."""
    lines = [line for block in matrix.blocks for line in block.lines]
    names = [_short(line.name, _LONGEST) for line in lines]
    left = _MATRIX_EDGE + _LINE + 0.1 + _LETTER * max(map(len, names))
    places = _places(matrix, lines, left)
    right = max(x + width for x, width in places.values())
    needed = right + _MATRIX_EDGE
    wide = next((width for width in (COLUMN, PAGE) if needed <= width), needed)
    signs = [note for note in matrix.notes if not note.startswith("columns:")]
    notes = [figures.plain(", ".join(["framed: trained here", *signs]), 110)]
    notes += [f"hatched: {figures.plain(words, 100)}" for _, words in matrix.hatchings]
    top = _MATRIX_EDGE + _HEADS
    bottom = top + _MATRIX_HEIGHT * len(lines)
    figure = figures.blank_figure(wide, bottom + 0.1 + _LINE * (1.2 + len(notes)))
    axes = figures.inch_canvas(figure)
    for group in matrix.groups:
        first, last = places[group.cells[0].name][0], sum(places[group.cells[-1].name])
        name = figures.plain(group.label, 30).replace("_", "\n")
        axes.text(
            (first + last) / 2.0, top - 0.5, name, ha="center", va="bottom", linespacing=1.0,
            **_TYPE,
        )  # fmt: skip
        axes.plot([first + 0.03, last - 0.03], [top - 0.47] * 2, color=figures.INK, linewidth=0.6)
        for cell in group.cells:
            x, width = places[cell.name]
            axes.text(
                x + width / 2.0, top - 0.04, "" if cell.reference else step(cell.dt), ha="center",
                va="bottom", rotation=90, **_TYPE,
            )  # fmt: skip
    for number, (name, line) in enumerate(zip(names, lines, strict=True)):
        y = top + _MATRIX_HEIGHT * number
        middle = y + _MATRIX_HEIGHT / 2.0
        axes.text(left - 0.05, middle, name, ha="right", va="center", **_TYPE)
        for column, shade in line.shades.items():
            x, width = places[column]
            _draw_cell(axes, shade, x, y, width)
    axes.text(
        (left + right) / 2.0, bottom + _LINE, "judged on (integrator above, step in s)",
        ha="center", va="center", **_TYPE,
    )  # fmt: skip
    y = top
    for block in matrix.blocks:
        tall = _MATRIX_HEIGHT * len(block.lines)
        axes.text(
            _MATRIX_EDGE + 0.5 * _LINE, y + tall / 2.0, _short(block.title, tall),
            ha="center", va="center", rotation=90, **_TYPE,
        )  # fmt: skip
        y += tall
    for number, note in enumerate(notes):
        axes.text(_MATRIX_EDGE, bottom + _LINE * (number + 2.4), note, va="center", **_TYPE)
    return figure


def _places(
    matrix: Matrix, lines: Sequence[MatrixLine], left: float
) -> dict[str, tuple[float, float]]:
    """Name of every cell to left edge and width of its column, as wide as its numbers need."""
    places, x = {}, left
    for group in matrix.groups:
        for cell in group.cells:
            shades = [shade for line in lines if (shade := line.shades[cell.name])]
            needed = (_LETTER * len(shade.text) + 0.04 for shade in shades)
            width = max([_NARROWEST, *needed])
            places[cell.name] = (x, width)
            x += width
        x += _GROUP_GAP
    return places


def _draw_cell(axes: Axes, shade: Shade | None, x: float, y: float, width: float) -> None:
    size = width, _MATRIX_HEIGHT
    ink, behind = drawing.draw_shade(axes, shade, (x, y), size, 0.01, 0.5)
    if shade is not None and shade.home:
        drawing.draw_box(axes, (x, y), size, 0.02, fill=False, edgecolor=figures.INK, linewidth=1.3)
    text = "\n".join(filter(None, (shade.text, " ".join(shade.marks)))) if shade else NONE
    axes.text(
        x + width / 2.0, y + _MATRIX_HEIGHT / 2.0, text, ha="center", va="center", linespacing=0.95,
        bbox=behind, **{**_TYPE, "color": ink},
    )  # fmt: skip


STYLES: Final = ("page", "paper")
"""How figures look: as on the page, or as papers print them."""

_MATRIX = (drawing.draw_matrix, print_matrix)
_FOREST = (drawing.draw_forest, print_forest)
_LADDERS = (drawing.draw_ladders, print_ladders)

FIGURES: Final[dict[str, tuple[Any, tuple[Any, Any]]]] = {
    "success_matrix": (success_matrix, _MATRIX),
    "return_matrix": (return_matrix, _MATRIX),
    "transfer_gaps": (forests.gap_forest, _FOREST),
    "paired_success": (forests.paired_success, _FOREST),
    "paired_return": (forests.paired_return, _FOREST),
    "energy_residual": (energy_matrix, _MATRIX),
    "refinement_ladder": (ladder_plots, _LADDERS),
    "sweeps": (sweep_plots, _LADDERS),
    "perturbations": (forests.check_forest, _FOREST),
    "remedy": (forests.remedy_forest, _FOREST),
}
"""Name of a figure to what describes it, as for the page, and what draws that in each style."""


def write_figures(panel: Panel, directory: str | PathLike[str], style: str = "page") -> list[Path]:
    """Write a panel's figures as PNG, SVG and PDF files into a folder.

    A figure for which the panel has no numbers is not written, and one left there by an earlier
    run under the same name is removed.

    Parameters
    ----------
    panel
        What ``panel.json`` holds.
    directory
        The folder the files go to; made if it does not exist.
    style
        One of :data:`STYLES`.

    Returns
    -------
    The files written, each complete as soon as it is there.

    Raises
    ------
    ModuleNotFoundError
        If matplotlib is not installed, with the command that installs it.
    """
    load("matplotlib", "report")
    written: list[Path] = []
    for name, (describe, draw) in FIGURES.items():
        path, described = Path(directory) / name, describe(panel)
        if described is not None:
            written += figures.write_figure(draw[STYLES.index(style)](described), path)
        else:
            for suffix in figures.FORMATS:
                path.with_suffix(suffix).unlink(missing_ok=True)
    return written
