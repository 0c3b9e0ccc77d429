"""What the figures of a diagnosis share: lines of integrators, and grids of plots."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from integ_gym.envs.registries import TRUTH
from integ_gym.support.figures import (
    COOL,
    INK,
    LINE,
    PAPER,
    SOFT,
    WARM,
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
from integ_gym.support.terminal import step

from ..scheme_style import styles_of
from .subject import theory_of

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


_BAND: Final[dict[str, Any]] = {"color": "#c9cad0", "linewidth": 5.0, "solid_capstyle": "round"}
_SMALLEST: Final = 1e-16
_LINEAR: Final = 3.0  # energies within this factor of the start's are drawn on a linear axis


def draw_energy(curves: Sequence[Curve], schemes: SeriesStyles) -> Figure:
    """Energy over time, and how far it is off."""
    plants = plants_of(curves)
    heading = (
        "Energy of free motion",
        "released from rest, no control, no damping; above: energy; below: the largest error "
        "within each period of the fastest oscillation",
    )
    figure, places = draw_grid(heading, entries(schemes), (2, len(plants)), (3.6, 2.3))
    for plant, (upper, lower) in zip(plants, places.T, strict=True):
        own = [c for c in curves if c["plant"] == plant]
        _energies(upper, own, schemes)
        _errors(lower, own, schemes)
        named(upper, f"{plant}, dt = {step(own[0]['dt'])} s", "", "E / E at the start")
        named(lower, "", "time, s", "|E / E at the start − 1|")
    return figure


def _energies(axes: Axes, curves: Sequence[Curve], schemes: SeriesStyles) -> None:
    ratios = [1.0 + numbers(c["change"]) for c in curves]
    low = min(float(np.nanmin(r)) for r in ratios)
    high = max(float(np.nanmax(r)) for r in ratios)
    for curve, ratio in zip(curves, ratios, strict=True):
        style = curve_style(curve["integrator"], schemes)
        axes.plot(numbers(curve["time"]), np.maximum(ratio, _SMALLEST), **style)
    if low > 1.0 / _LINEAR and high < _LINEAR:
        reach = 1.25 * max(high - 1.0, 1.0 - low, 1e-3)
        axes.set_ylim(1.0 - reach, 1.0 + reach)
    else:
        axes.set_yscale("log")
        axes.set_ylim(min(0.5, max(0.5 * low, 1e-3)), max(2.0, min(2.0 * high, 1e3)))
    _over_time(axes, curves)


def _over_time(axes: Axes, curves: Sequence[Curve]) -> None:
    axes.set_xlim(0.0, max(float(numbers(c["time"])[-1]) for c in curves))
    axes.minorticks_off()


def _errors(axes: Axes, curves: Sequence[Curve], schemes: SeriesStyles) -> None:
    for curve in curves:
        time, error = numbers(curve["time"]), np.abs(numbers(curve["change"]))
        window = int(curve["window"])
        largest, middle = windows(error, window).max(axis=1), windows(time, window).mean(axis=1)
        style = curve_style(curve["integrator"], schemes)
        axes.semilogy(middle, np.maximum(largest, _SMALLEST), **style)
    axes.set_ylim(_SMALLEST, 1e3)
    _over_time(axes, curves)


def draw_phase(curves: Sequence[Curve], schemes: SeriesStyles) -> Figure:
    """Phase portraits, one for each plant and integrator, over the truth."""
    plants, names = plants_of(curves), list(schemes) or [TRUTH]
    heading = (
        "Phase portraits of free motion",
        "released from rest, no control, no damping; thick grey: reference",
    )
    across = len(names) > 2
    rows, columns = (plants, names) if across else (names, plants)
    size = (1.75, 1.75) if across else (2.2, 2.6)
    shape = (len(rows), len(columns))
    figure, places = draw_grid(heading, entries(schemes, _BAND), shape, size)
    for row, line in zip(rows, places, strict=True):
        for column, axes in zip(columns, line, strict=True):
            plant, name = (row, column) if across else (column, row)
            found = {c["integrator"]: c for c in curves if c["plant"] == plant}
            _portrait(axes, found[name], found[TRUTH], schemes)
            (x, v), (x_unit, v_unit) = found[name]["names"], found[name]["units"]
            outer = f"{plain(row, 20)}: " if len(rows) > 1 and axes is line[0] else ""
            title = plain(column, 20) if row == rows[0] else ""
            named(axes, title, f"{x}, {x_unit}", f"{outer}{v}, {v_unit}")
            axes.title.set_fontsize(8.5)
    return figure


def _portrait(axes: Axes, curve: Curve, truth: Curve, schemes: SeriesStyles) -> None:
    position, velocity = numbers(truth["position"]), numbers(truth["velocity"])
    axes.plot(position, velocity, **_BAND)
    if curve is not truth:
        style: dict[str, Any] = {**curve_style(curve["integrator"], schemes), "linewidth": 1.2}
        axes.plot(numbers(curve["position"]), numbers(curve["velocity"]), **style)
    middle = 0.5 * (np.nanmax(position) + np.nanmin(position))
    reach = 2.0 * max(np.nanmax(position) - middle, 1e-9)
    fastest = 2.0 * max(float(np.nanmax(np.abs(velocity))), 1e-9)
    axes.set(xlim=(middle - reach, middle + reach), ylim=(-fastest, fastest))


Array = np.ndarray[Any, Any]

_OFF: Final = 0.5  # error with the fullest colour
_POWERS: Final = (-6.0, 0.0)  # of ten, of the ledger residual from none to the fullest colour


class _Map(NamedTuple):
    """One quantity over step and stiffness."""

    key: str
    title: str
    limits: tuple[float, float]
    ticks: dict[float, str]


_MAPS: Final = (
    _Map(
        "rebound", "rebound energy − analytic", (-_OFF, _OFF),
        {-_OFF: "−0.5: drained", 0.0: "exact", _OFF: "+0.5: pumped"},
    ),
    _Map(
        "penetration", "penetration / analytic − 1", (-_OFF, _OFF),
        {-_OFF: "−0.5: shallow", 0.0: "exact", _OFF: "+0.5: deep"},
    ),
    _Map(
        "residual", "Σ |residual| / impact energy", _POWERS,
        {-6.0: "10⁻⁶", -3.0: "10⁻³", 0.0: "1"},
    ),
)  # fmt: skip

_LEGEND: Final = (
    Entry("energy gained beyond", {"color": INK, "linewidth": 1.8}),
    Entry("oscillator's limit", {"color": INK, "linewidth": 1.0, "linestyle": (0, (3, 2))}),
)


def draw_contact(curves: Sequence[Curve], schemes: SeriesStyles) -> Figure:
    """Rebound, penetration and ledger of one plant's impact, for every integrator."""
    names = [name for name in schemes if any(c["integrator"] == name for c in curves)]
    found = {c["integrator"]: c for c in curves}
    heading = (
        f"Contact of {curves[0]['plant']}: one impact over step and stiffness",
        "worst of 4 places within a step at which the stop is touched (mean for the ledger); up: "
        "larger steps, right: stiffer stops",
    )
    across, shape = len(names) > 1, (len(_MAPS), len(names))
    if across:
        figure, places = draw_grid(heading, _LEGEND, shape, (1.75, 1.75), right=1.6)
    else:
        figure, beside = draw_grid(heading, _LEGEND, shape[::-1], (2.2, 2.2), below=1.0)
        places = beside.T
    for i, quantity in enumerate(_MAPS):
        for j, name in enumerate(names):
            axes = places[i, j]
            mesh = _draw_map(axes, found[name], quantity)
            title = "" if across and i else name if across else quantity.title
            inner = j > 0 if across else i > 0
            named(axes, title, f"stiffness, {found[name]['unit']}", "" if inner else "step, s")
            axes.title.set_fontsize(8.0)
            if inner:
                axes.set_yticklabels([])
        _bar(figure, places[i, -1], mesh, quantity, across)
    return figure


def _draw_map(axes: Axes, curve: Curve, quantity: _Map) -> Any:
    from matplotlib.colors import LinearSegmentedColormap

    low, high = quantity.limits
    values = np.array([numbers(line) for line in curve[quantity.key]])
    values = np.where(np.isnan(values), math.inf, values)
    if quantity.key == "residual":
        colours = LinearSegmentedColormap.from_list("size", (PAPER, WARM))
        values = np.log10(np.maximum(values, 1e-300))
    else:
        colours = LinearSegmentedColormap.from_list("error", (COOL, PAPER, WARM))
    stiffness, steps = numbers(curve["stiffness"]), numbers(curve["steps"])
    across, up = _edges(stiffness), _edges(steps)
    axes.grid(visible=False)
    mesh = axes.pcolormesh(
        across, up, np.clip(values, low, high), cmap=colours, vmin=low, vmax=high
    )
    _boundary(axes, np.array(curve["gains"], dtype=bool), across, up)
    theory = theory_of(curve["integrator"])
    if theory is not None and 0.0 < theory.oscillation_limit < math.inf:
        limit = theory.oscillation_limit / numbers(curve["rates"])
        axes.plot(stiffness, limit, color=INK, linewidth=1.0, linestyle=(0, (3, 2)))
    axes.set(xscale="log", yscale="log", xlim=across[[0, -1]], ylim=up[[-1, 0]])
    axes.minorticks_off()
    axes.set_yticks(steps, [f"{x:.2g}" for x in steps])
    return mesh


def _bar(figure: Figure, axes: Axes, mesh: Any, quantity: _Map, beside: bool) -> None:
    """The colours of a quantity: beside the last plot of its row, or under its plot."""
    wide, high = (float(x) for x in figure.get_size_inches())
    box = axes.get_position()
    if beside:
        place = axes_at(figure, box.x1 * wide + 0.2, box.y0 * high, 0.12, box.height * high)
        bar = figure.colorbar(mesh, cax=place)
        bar.set_label(quantity.title, size=8, color=INK)
    else:
        place = axes_at(figure, box.x0 * wide, box.y0 * high - 0.6, box.width * wide, 0.1)
        bar = figure.colorbar(mesh, cax=place, orientation="horizontal")
    bar.outline.set_visible(False)
    bar.set_ticks(list(quantity.ticks), labels=list(quantity.ticks.values()))
    bar.ax.tick_params(labelsize=7, colors=SOFT, length=0)
    if not beside:
        first, *_, last = bar.ax.get_xticklabels()
        first.set_horizontalalignment("left")
        last.set_horizontalalignment("right")


def _edges(centres: Array) -> Array:
    """Edges of cells around geometrically spaced centres."""
    ratio = math.sqrt(centres[1] / centres[0])
    edges: Array = np.append(centres / ratio, centres[-1] * ratio)
    return edges


def _boundary(axes: Axes, inside: Array, across: Array, up: Array) -> None:
    """The line between cells that are inside and those that are not."""
    for row, column in np.argwhere(inside[:, 1:] != inside[:, :-1]):
        axes.plot(across[[column + 1] * 2], up[row : row + 2], color=INK, linewidth=1.8)
    for row, column in np.argwhere(inside[1:] != inside[:-1]):
        axes.plot(across[column : column + 2], up[[row + 1] * 2], color=INK, linewidth=1.8)
