"""What the figures of a diagnosis share: lines of integrators, and grids of plots."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from integ_gym.envs.registries import TRUTH
from integ_gym.support.figures import (
    INK,
    LINE,
    SOFT,
    Entry,
    SeriesStyles,
    axes_at,
    bare,
    blank_figure,
    draw_heading,
    draw_legend,
    inch_canvas,
    legend_lines,
    line_style,
    plain,
    scheme_entries,
)

from ...scheme_style import styles_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Curve = Mapping[str, Any]
"""One curve of ``diagnose.json``."""

NARROWEST: Final = 8.4
"""Inches of the narrowest figure: its heading needs them."""

_LEFT: Final = 0.85
_GAP: Final = (0.8, 0.85)  # inches between plots
_HEADING: Final = 0.8
_LINE: Final = 0.2


def schemes_of(names: Iterable[str]) -> SeriesStyles:
    """Styles of all integrators but the truth, which is drawn by itself."""
    return styles_of(name for name in names if name != TRUTH)


def curve_style(name: str, schemes: SeriesStyles) -> dict[str, Any]:
    """The line of an integrator; later ones are thinner, so that none hides another."""
    if name == TRUTH:
        return {"color": INK, "linewidth": 1.0, "linestyle": (0, (4, 3)), "zorder": 4}
    later = len(schemes) - 1 - list(schemes).index(name)
    return line_style(schemes[name], 1.2 + 0.3 * max(0, later))


def entries(schemes: SeriesStyles, truth: Mapping[str, Any] | None = None) -> list[Entry]:
    """A legend of integrators, and of the truth in the style in which it is drawn."""
    style = curve_style(TRUTH, {}) if truth is None else truth
    return [*scheme_entries(schemes), Entry(TRUTH, style)]


def draw_grid(
    heading: tuple[str, str],
    legend: Sequence[Entry],
    shape: tuple[int, int],
    size: tuple[float, float],
    right: float = 0.35,
    legible: float = 0.4,
    below: float = 0.62,
) -> tuple[Figure, np.ndarray[Any, Any]]:
    """A figure with a heading, a legend and a grid of empty plots.

    Args:
        heading: what it shows, and how to read it.
        legend: its entries.
        shape: rows and columns of plots.
        size: inches of each, wide and high; they are made wider where the figure would be too
            narrow.
        right: inches to the right of them.
        legible: inches between the legend and the plots.
        below: inches under them.

    Returns:
        The figure, and its plots in an array of that shape.
    """
    rows, columns = shape
    down = size[1]
    across = max(size[0], (NARROWEST - _LEFT - right - (columns - 1) * _GAP[0]) / columns)
    wide = _LEFT + columns * (across + _GAP[0]) - _GAP[0] + right
    about = _wrapped(heading[1], wide - 0.6)
    head = _HEADING + (len(about) - 1) * _LINE
    top = head + (legend_lines(legend, wide) if legend else 0) * _LINE + legible
    high = top + rows * (down + _GAP[1]) - _GAP[1] + below
    figure = blank_figure(wide, high)
    canvas = inch_canvas(figure)
    draw_heading(canvas, 0.3, heading[0], about[0])
    for i, more in enumerate(about[1:], start=1):
        canvas.text(0.3, 0.62 + i * _LINE, more, size=9, color=SOFT, va="baseline")
    draw_legend(canvas, legend, wide, head + 0.12)
    places = np.empty(shape, dtype=object)
    for row, column in np.ndindex(shape):
        left, low = _LEFT + column * (across + _GAP[0]), high - top - down - row * (down + _GAP[1])
        axes = axes_at(figure, left, low, across, down)
        _quiet(axes)
        places[row, column] = axes
    return figure, places


def _wrapped(text: str, wide: float) -> list[str]:
    """The heading's small print in lines that fit a width in inches."""
    from matplotlib.textpath import TextPath

    def fits(line: str) -> bool:
        """By the points that span its curves; only where they reach too far, by the curves."""
        path = TextPath((0.0, 0.0), line, size=9)
        points = float(np.ptp(np.asarray(path.vertices)[:, 0]))
        return points / 72.0 <= wide or path.get_extents().width / 72.0 <= wide

    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if fits(longer):
            lines[-1] = longer
        else:
            lines.append(word)
    return lines


def _quiet(axes: Axes) -> None:
    bare(axes)
    axes.spines["left"].set_visible(True)
    axes.spines["left"].set_color(LINE)
    axes.grid(color=LINE, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.minorticks_off()


def named(axes: Axes, title: str, x: str, y: str) -> None:
    """Title and labels of a plot."""
    axes.set_title(plain(title), size=10, color=INK, loc="left", weight="bold", pad=5)
    axes.set_xlabel(x, size=8, color=SOFT, labelpad=2)
    axes.set_ylabel(y, size=8, color=SOFT, labelpad=2)


def numbers(values: Sequence[float | None]) -> np.ndarray[Any, Any]:
    """A curve's numbers; NaN where there is none."""
    return np.array([np.nan if x is None else x for x in values])


def windows(values: np.ndarray[Any, Any], window: int) -> np.ndarray[Any, Any]:
    """Values in rows of ``window``; what fills none is left out."""
    return values[: len(values) // window * window].reshape(-1, window)


def plants_of(curves: Sequence[Curve]) -> list[str]:
    """The plants that curves belong to, in their order."""
    return list(dict.fromkeys(str(c["plant"]) for c in curves))
