"""The figures of a diagnosis: energy, phase portraits, stability, errors, and contact."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from integ_gym.envs.registries import TRUTH
from integ_gym.support import figures
from integ_gym.support.optional import load
from integ_gym.support.terminal import step

from ..scheme_style import styles_of
from .subject import Array, theory_of

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
_BAND: Final[dict[str, Any]] = {"color": "#c9cad0", "linewidth": 5.0, "solid_capstyle": "round"}
_SMALLEST: Final = 1e-16
_LINEAR: Final = 3.0  # energies within this factor of the start's are drawn on a linear axis
_MOST_COLUMNS: Final = 3
_WIDEST: Final = 6.3  # hω


def schemes_of(names: Iterable[str]) -> figures.SeriesStyles:
    """Styles of all integrators but the truth, which is drawn by itself."""
    return styles_of(name for name in names if name != TRUTH)


def curve_style(name: str, schemes: figures.SeriesStyles) -> dict[str, Any]:
    """The line of an integrator; later ones are thinner, so that none hides another."""
    if name == TRUTH:
        return {"color": figures.INK, "linewidth": 1.0, "linestyle": (0, (4, 3)), "zorder": 4}
    later = len(schemes) - 1 - list(schemes).index(name)
    return figures.line_style(schemes[name], 1.2 + 0.3 * max(0, later))


def entries(schemes: figures.SeriesStyles, *truth: Mapping[str, Any]) -> list[figures.Entry]:
    """A legend of integrators, and of the truth in the style in which it is drawn."""
    return [
        *figures.scheme_entries(schemes),
        figures.Entry(TRUTH, *(truth or (curve_style(TRUTH, {}),))),
    ]


def draw_grid(
    heading: tuple[str, str],
    legend: Sequence[figures.Entry],
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
    about = _wrap(heading[1], wide - 0.6)
    head = _HEADING + (len(about) - 1) * _LINE
    top = head + (figures.legend_lines(legend, wide) if legend else 0) * _LINE + legible
    high = top + rows * (down + _GAP[1]) - _GAP[1] + below
    figure = figures.blank_figure(wide, high)
    canvas = figures.inch_canvas(figure)
    figures.draw_heading(canvas, 0.3, heading[0], about[0])
    for i, more in enumerate(about[1:], start=1):
        canvas.text(0.3, 0.62 + i * _LINE, more, size=9, color=figures.SOFT, va="baseline")
    figures.draw_legend(canvas, legend, wide, head + 0.12)
    places = np.empty(shape, dtype=object)
    for row, column in np.ndindex(shape):
        left, low = _LEFT + column * (across + _GAP[0]), high - top - down - row * (down + _GAP[1])
        places[row, column] = axes = figures.axes_at(figure, left, low, across, down)
        figures.bare(axes)
        axes.spines["left"].set_visible(True)
        axes.spines["left"].set_color(figures.LINE)
        axes.grid(color=figures.LINE, linewidth=0.6)
        axes.set_axisbelow(True)
        axes.minorticks_off()
    return figure, places


def _wrap(text: str, wide: float) -> list[str]:
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


def label_axes(axes: Axes, title: str, x: str, y: str) -> None:
    """Title and labels of a plot."""
    axes.set_title(
        figures.plain(title), size=10, color=figures.INK, loc="left", weight="bold", pad=5
    )
    axes.set_xlabel(x, size=8, color=figures.SOFT, labelpad=2)
    axes.set_ylabel(y, size=8, color=figures.SOFT, labelpad=2)


def _numbers(values: Sequence[float | None]) -> Array:
    """A curve's numbers; NaN where there is none."""
    return np.array([np.nan if x is None else x for x in values])


def windows(values: Array, window: int) -> Array:
    """Values in rows of ``window``; what fills none is left out."""
    return values[: len(values) // window * window].reshape(-1, window)


def _plants_of(curves: Sequence[Curve]) -> list[str]:
    """The plants that curves belong to, in their order."""
    return list(dict.fromkeys(str(c["plant"]) for c in curves))


def draw_energy(curves: Sequence[Curve], schemes: figures.SeriesStyles) -> Figure:
    """Energy over time, and how far it is off."""
    plants = _plants_of(curves)
    heading = (
        "Energy of free motion",
        "released from rest, no control, no damping; above: energy; below: the largest error "
        "within each period of the fastest oscillation",
    )
    figure, places = draw_grid(heading, entries(schemes), (2, len(plants)), (3.6, 2.3))
    for plant, (upper, lower) in zip(plants, places.T, strict=True):
        own = [c for c in curves if c["plant"] == plant]
        ratios = [1.0 + _numbers(c["change"]) for c in own]
        for curve, ratio in zip(own, ratios, strict=True):
            style, window = curve_style(curve["integrator"], schemes), int(curve["window"])
            time = _numbers(curve["time"])
            upper.plot(time, np.maximum(ratio, _SMALLEST), **style)
            largest = windows(np.abs(_numbers(curve["change"])), window).max(axis=1)
            middle = windows(time, window).mean(axis=1)
            lower.semilogy(middle, np.maximum(largest, _SMALLEST), **style)
        low, high = (float(f([f(r) for r in ratios])) for f in (np.nanmin, np.nanmax))
        if low > 1.0 / _LINEAR and high < _LINEAR:
            reach = 1.25 * max(high - 1.0, 1.0 - low, 1e-3)
            upper.set_ylim(1.0 - reach, 1.0 + reach)
        else:
            upper.set_yscale("log")
            upper.set_ylim(min(0.5, max(0.5 * low, 1e-3)), max(2.0, min(2.0 * high, 1e3)))
        lower.set_ylim(_SMALLEST, 1e3)
        for axes in (upper, lower):
            axes.set_xlim(0.0, max(float(_numbers(c["time"])[-1]) for c in own))
            axes.minorticks_off()
        label_axes(upper, f"{plant}, dt = {step(own[0]['dt'])} s", "", "E / E at the start")
        label_axes(lower, "", "time, s", "|E / E at the start − 1|")
    return figure


def draw_phase(curves: Sequence[Curve], schemes: figures.SeriesStyles) -> Figure:
    """Phase portraits, one for each plant and integrator, over the truth."""
    plants, names = _plants_of(curves), list(schemes) or [TRUTH]
    heading = (
        "Phase portraits of free motion",
        "released from rest, no control, no damping; thick grey: reference",
    )
    across = len(names) > 2
    rows, columns = (plants, names) if across else (names, plants)
    size = (1.75, 1.75) if across else (2.2, 2.6)
    figure, places = draw_grid(heading, entries(schemes, _BAND), (len(rows), len(columns)), size)
    for (i, j), axes in np.ndenumerate(places):
        plant, name = (rows[i], columns[j]) if across else (columns[j], rows[i])
        found = {c["integrator"]: c for c in curves if c["plant"] == plant}
        curve, truth = found[name], found[TRUTH]
        position, velocity = _numbers(truth["position"]), _numbers(truth["velocity"])
        axes.plot(position, velocity, **_BAND)
        if curve is not truth:
            style = {**curve_style(name, schemes), "linewidth": 1.2}
            axes.plot(_numbers(curve["position"]), _numbers(curve["velocity"]), **style)
        middle = 0.5 * (np.nanmax(position) + np.nanmin(position))
        reach = 2.0 * max(np.nanmax(position) - middle, 1e-9)
        fastest = 2.0 * max(float(np.nanmax(np.abs(velocity))), 1e-9)
        axes.set(xlim=(middle - reach, middle + reach), ylim=(-fastest, fastest))
        (x, v), (x_unit, v_unit) = curve["names"], curve["units"]
        outer = f"{figures.plain(rows[i], 20)}: " if len(rows) > 1 and j == 0 else ""
        title = "" if i else figures.plain(columns[j], 20)
        label_axes(axes, title, f"{x}, {x_unit}", f"{outer}{v}, {v_unit}")
        axes.title.set_fontsize(8.5)
    return figure


def draw_stability(curves: Sequence[Curve], schemes: figures.SeriesStyles) -> Figure:
    """Growth per step of small oscillations against hω."""
    plants = _plants_of(curves)
    heading = (
        "Stability of small oscillations",
        "growth per step against step × fastest frequency: line, any motion, one step linearized "
        "at rest; marker, the fastest oscillation, followed; above 1: growth",
    )
    figure, places = draw_grid(heading, entries(schemes), (1, len(plants)), (3.6, 2.8))
    for axes, plant in zip(places[0], plants, strict=True):
        axes.axhline(1.0, **curve_style(TRUTH, schemes))
        limits = set()
        for curve in (c for c in curves if c["plant"] == plant):
            name, theory = curve["integrator"], theory_of(curve["integrator"])
            if theory is not None and 0.0 < theory.oscillation_limit < math.inf:
                limits.add(theory.oscillation_limit)
            if name == TRUTH:
                continue
            style = curve_style(name, schemes)
            axes.plot(_numbers(curve["h_omega"]), _numbers(curve["radius"]), **style)
            marks = {
                **figures.marker_style(schemes[name]),
                "color": style["color"],
                "linestyle": "none",
            }
            axes.plot(_numbers(curve["followed"]), _numbers(curve["growth"]), zorder=3, **marks)
        for limit in limits:  # what theory says of where growth begins
            axes.axvline(
                limit, color=figures.SOFT, linewidth=0.8, linestyle=(0, (1, 2)), zorder=0.5
            )
            axes.annotate(
                f"limit {limit:.3g}", (limit, 0.0), xytext=(3, 4), textcoords="offset points",
                size=7, color=figures.SOFT,
            )  # fmt: skip
        axes.set(ylim=(0.0, 3.0), xlim=(0.0, _WIDEST))
        label_axes(axes, plant, "hω", "factor on the amplitude per step")
    return figure


def draw_convergence(curves: Sequence[Curve], schemes: figures.SeriesStyles) -> Figure:
    """Error against step."""
    heading = (
        "Convergence",
        "largest error in one driven period at a fixed control period, against the truth; the "
        "truth's own error is against SciPy's DOP853",
    )
    return _draw_errors(curves, schemes, heading, entries(schemes), "steps", "step, s")


def draw_work(curves: Sequence[Curve], schemes: figures.SeriesStyles) -> Figure:
    """Error against cost."""
    heading = (
        "Work and precision",
        "the same errors against evaluations of accelerations and Jacobians, from coarse to fine "
        "steps; down and left is better",
    )
    star = {"color": figures.INK, "marker": "*", "markersize": 9}
    legend = entries(schemes, {"color": figures.INK, "linewidth": 0.0}, star)
    label = "evaluations per simulated second"
    return _draw_errors(curves, schemes, heading, legend, "evaluations_per_second", label)


def _draw_errors(
    curves: Sequence[Curve],
    schemes: figures.SeriesStyles,
    heading: tuple[str, str],
    legend: Sequence[figures.Entry],
    across: str,
    label: str,
) -> Figure:
    """One plot for every coordinate of every plant, over the field ``across`` of its curves."""
    shown = list(dict.fromkeys((c["plant"], c["coordinate"]) for c in curves))
    columns = min(len(shown), _MOST_COLUMNS)
    rows = math.ceil(len(shown) / columns)
    figure, places = draw_grid(heading, legend, (rows, columns), (3.4, 2.9))
    for axes, (plant, coordinate) in zip(places.flat, shown, strict=False):
        own = [c for c in curves if (c["plant"], c["coordinate"]) == (plant, coordinate)]
        for curve in own:
            name, errors = curve["integrator"], np.maximum(_numbers(curve["errors"]), _SMALLEST)
            if name != TRUTH:
                style = {**curve_style(name, schemes), **figures.marker_style(schemes[name])}
                axes.loglog(_numbers(curve[across]), errors, **style)
            elif across == "steps":
                axes.axhline(errors[0], **curve_style(name, schemes))
            else:
                axes.loglog(
                    _numbers(curve[across]), errors, "*", color=figures.INK, markersize=9, zorder=5
                )
        if across == "steps":
            _draw_slopes(axes, own)
        error = f"error of {coordinate}, {own[0]['unit']}"
        label_axes(axes, f"{plant}: {coordinate}", label, error)
        axes.minorticks_off()
    for axes in places.flat[len(shown) :]:
        axes.set_visible(False)
    return figure


def _draw_slopes(axes: Axes, curves: Sequence[Curve]) -> None:
    """A line of every declared slope below the most accurate curve that has it."""
    best: dict[int, tuple[float, Curve]] = {}
    for curve in curves:
        order, error = curve["order"], _numbers(curve["errors"])[0]
        if curve["integrator"] == TRUTH or order is None or not np.isfinite(error):
            continue
        if order not in best or error < best[order][0]:
            best[order] = (error, curve)
    low, high = axes.get_ylim()
    for order, (error, curve) in best.items():
        steps = _numbers(curve["steps"])
        guide = 0.3 * error * (steps / steps[0]) ** order
        axes.loglog(
            steps, guide, color=figures.SOFT, linewidth=0.8, linestyle=(0, (1, 2)), zorder=0.5
        )
        axes.annotate(
            f"slope {order}", (steps[-2], guide[-2]), xytext=(3, -3),
            textcoords="offset points", size=7, color=figures.SOFT, va="top",
        )  # fmt: skip
    axes.set_ylim(max(0.3 * low, 0.1 * _SMALLEST), high)


class _Map(NamedTuple):
    """One quantity over step and stiffness."""

    key: str
    title: str
    colours: tuple[str, ...]
    ticks: dict[float, str]  # its lowest and highest are the limits of the colours


_ERROR: Final = (figures.COOL, figures.PAPER, figures.WARM)
_MAPS: Final = (
    _Map(
        "rebound", "rebound energy − analytic", _ERROR,
        {-0.5: "−0.5: drained", 0.0: "exact", 0.5: "+0.5: pumped"},
    ),
    _Map(
        "penetration", "penetration / analytic − 1", _ERROR,
        {-0.5: "−0.5: shallow", 0.0: "exact", 0.5: "+0.5: deep"},
    ),
    _Map(  # powers of ten
        "residual", "Σ |residual| / impact energy", (figures.PAPER, figures.WARM),
        {-6.0: "10⁻⁶", -3.0: "10⁻³", 0.0: "1"},
    ),
)  # fmt: skip

_LEGEND: Final = (
    figures.Entry("energy gained beyond", {"color": figures.INK, "linewidth": 1.8}),
    figures.Entry(
        "oscillator's limit", {"color": figures.INK, "linewidth": 1.0, "linestyle": (0, (3, 2))}
    ),
)


def draw_contact(curves: Sequence[Curve], schemes: figures.SeriesStyles) -> Figure:
    """Rebound, penetration and ledger of one plant's impact, for every integrator."""
    found = {c["integrator"]: c for c in curves}
    names = [name for name in schemes if name in found]
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
            unit = found[name]["unit"]
            label_axes(axes, title, f"stiffness, {unit}", "" if inner else "step, s")
            axes.title.set_fontsize(8.0)
            if inner:
                axes.set_yticklabels([])
        _draw_scale(figure, places[i, -1], mesh, quantity, across)
    return figure


def _draw_map(axes: Axes, curve: Curve, quantity: _Map) -> Any:
    from matplotlib.colors import LinearSegmentedColormap

    low, *_, high = quantity.ticks
    values = np.array([_numbers(line) for line in curve[quantity.key]])
    values = np.where(np.isnan(values), math.inf, values)
    if quantity.key == "residual":
        values = np.log10(np.maximum(values, 1e-300))
    colours = LinearSegmentedColormap.from_list(quantity.key, quantity.colours)
    stiffness, steps = _numbers(curve["stiffness"]), _numbers(curve["steps"])
    across, up = (  # edges of cells around geometrically spaced centres
        np.append(x / math.sqrt(x[1] / x[0]), x[-1] * math.sqrt(x[1] / x[0]))
        for x in (stiffness, steps)
    )
    axes.grid(visible=False)
    mesh = axes.pcolormesh(
        across, up, np.clip(values, low, high), cmap=colours, vmin=low, vmax=high
    )
    gains = np.array(curve["gains"], dtype=bool)
    for row, column in np.argwhere(gains[:, 1:] != gains[:, :-1]):
        axes.plot(across[[column + 1] * 2], up[row : row + 2], color=figures.INK, linewidth=1.8)
    for row, column in np.argwhere(gains[1:] != gains[:-1]):
        axes.plot(across[column : column + 2], up[[row + 1] * 2], color=figures.INK, linewidth=1.8)
    theory = theory_of(curve["integrator"])
    if theory is not None and 0.0 < theory.oscillation_limit < math.inf:
        limit = theory.oscillation_limit / _numbers(curve["rates"])
        axes.plot(stiffness, limit, color=figures.INK, linewidth=1.0, linestyle=(0, (3, 2)))
    axes.set(xscale="log", yscale="log", xlim=across[[0, -1]], ylim=up[[-1, 0]])
    axes.minorticks_off()
    axes.set_yticks(steps, [f"{x:.2g}" for x in steps])
    return mesh


def _draw_scale(figure: Figure, axes: Axes, mesh: Any, quantity: _Map, beside: bool) -> None:
    """The colours of a quantity: beside the last plot of its row, or under its plot."""
    wide, high = (float(x) for x in figure.get_size_inches())
    box = axes.get_position()
    if beside:
        place = figures.axes_at(figure, box.x1 * wide + 0.2, box.y0 * high, 0.12, box.height * high)
        bar = figure.colorbar(mesh, cax=place)
        bar.set_label(quantity.title, size=8, color=figures.INK)
    else:
        place = figures.axes_at(figure, box.x0 * wide, box.y0 * high - 0.6, box.width * wide, 0.1)
        bar = figure.colorbar(mesh, cax=place, orientation="horizontal")
    bar.outline.set_visible(False)
    bar.set_ticks(list(quantity.ticks), labels=list(quantity.ticks.values()))
    bar.ax.tick_params(labelsize=7, colors=figures.SOFT, length=0)
    if not beside:
        first, *_, last = bar.ax.get_xticklabels()
        first.set_horizontalalignment("left")
        last.set_horizontalalignment("right")


FIGURES: Final[dict[str, tuple[str, Callable[[Sequence[Curve], figures.SeriesStyles], Figure]]]] = {
    "energy": ("free_motion", draw_energy),
    "phase_portraits": ("free_motion", draw_phase),
    "stability": ("stiffness", draw_stability),
    "convergence": ("refinement", draw_convergence),
    "work_precision": ("refinement", draw_work),
}
"""File to the curves that it shows, and how; contact has a file for every plant."""


def write_diagnosis_figures(result: Mapping[str, Any], directory: Path) -> list[Path]:
    """Write a diagnosis's figures as PNG, SVG and PDF files into a folder.

    Args:
        result: content of ``diagnose.json``.
        directory: made if it does not exist.

    Returns:
        The files written.

    Raises:
        ModuleNotFoundError: without matplotlib, with the command that installs it.
    """
    load("matplotlib", "report")
    written: list[Path] = []
    schemes, curves = schemes_of(result["integrators"]), result["curves"]
    for name, (key, draw) in FIGURES.items():
        if curves.get(key):
            written += figures.write_figure(draw(curves[key], schemes), directory / name)
    impacts = curves.get("contact", [])
    for plant in _plants_of(impacts):
        own = [c for c in impacts if c["plant"] == plant]
        name = f"contact_{re.sub(r'[^A-Za-z0-9._]+', '-', plant)}"
        written += figures.write_figure(draw_contact(own, schemes), directory / name)
    return written
