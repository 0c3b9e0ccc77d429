"""Figures of a diagnosis as PNG files, drawn from ``diagnose.json`` alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from integ_gym.envs.extras import load
from integ_gym.eval.diagnosis.section import TRUTH
from integ_gym.eval.diagnosis.theory import THEORY
from integ_gym.eval.figure_style import (
    COOL,
    INK,
    LINE,
    PAPER,
    SCHEME_COLOURS,
    SCHEME_MARKERS,
    SOFT,
    WARM,
    axes_at,
    bare,
    blank_figure,
    draw_heading,
    inch_canvas,
    plain,
    png,
    scheme_legend,
)
from integ_gym.eval.report_data import compact, step
from integ_gym.evidence.atomic import replace_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Curve = Mapping[str, Any]

_LEFT: Final = 0.85
_TOP: Final = 1.5
_GAP: Final = (0.75, 0.8)  # inches between plots
_BOTTOM: Final = 0.62
_MARGIN: Final = 0.35
_WINDOW: Final = 2.0  # seconds, about one oscillation of the worked example
_REBOUND: Final = 0.5  # error of the rebound's energy share with the fullest colour
_SHADE: Final = "#c9cad0"  # the truth under a coloured line


def write_diagnosis_figures(result: Mapping[str, Any], directory: Path) -> list[Path]:
    """Write a diagnosis's figures as PNG files into a folder.

    Args:
        result: content of ``diagnose.json``.
        directory: made if it does not exist.

    Returns:
        The files written.

    Raises:
        ModuleNotFoundError: without matplotlib, with the command that installs it.
    """
    load("matplotlib", "report")
    written = []
    schemes = _schemes(x["name"] for x in result["integrators"])
    for name, (curves, draw) in _FIGURES.items():
        found = result["curves"].get(curves)
        if found:
            written.append(replace_file(directory / name, png(draw(found, schemes))))
    return written


def _schemes(names: Iterator[str]) -> dict[str, int]:
    """Place of every integrator's colour and marker; the truth is drawn in ink."""
    return {name: place for place, name in enumerate(n for n in names if n != TRUTH)}


def _style(name: str, schemes: Mapping[str, int]) -> dict[str, Any]:
    if name == TRUTH:
        return {"color": INK, "linewidth": 1.2, "linestyle": (0, (4, 3)), "zorder": 4}
    return {"color": SCHEME_COLOURS[schemes[name] % len(SCHEME_COLOURS)], "linewidth": 1.3}


def _marker(name: str, schemes: Mapping[str, int]) -> dict[str, Any]:
    marker = SCHEME_MARKERS[schemes[name] % len(SCHEME_MARKERS)]
    return {"marker": marker, "markersize": 5, "markeredgecolor": PAPER, "markeredgewidth": 0.6}


def _plants(curves: Sequence[Curve]) -> list[str]:
    return list(dict.fromkeys(str(c["plant"]) for c in curves))


def _grid(
    rows: int, columns: int, size: tuple[float, float], title: str, about: str,
    schemes: Mapping[str, int], top: float = _TOP, margin: float = _MARGIN,
) -> tuple[Figure, list[list[Axes]]]:  # fmt: skip
    """A figure with a heading, a legend and a grid of plots of a size in inches.

    ``top`` and ``margin`` are the inches above the plots and to their right.
    """
    wide = max(_LEFT + columns * (size[0] + _GAP[0]) - _GAP[0] + margin, 8.4)
    high = top + rows * (size[1] + _GAP[1]) - _GAP[1] + _BOTTOM
    figure = blank_figure(wide, high)
    canvas = inch_canvas(figure)
    draw_heading(canvas, 0.3, title, about)
    scheme_legend(canvas, schemes, wide)
    places = [
        [
            axes_at(
                figure,
                _LEFT + column * (size[0] + _GAP[0]),
                high - top - size[1] - row * (size[1] + _GAP[1]),
                *size,
            )
            for column in range(columns)
        ]
        for row in range(rows)
    ]
    for line in places:
        for axes in line:
            _quiet(axes)
    return figure, places


def _quiet(axes: Axes) -> None:
    bare(axes)
    axes.spines["left"].set_visible(True)
    axes.spines["left"].set_color(LINE)
    axes.grid(color=LINE, linewidth=0.6)
    axes.set_axisbelow(True)


def _name(axes: Axes, title: str, x: str, y: str) -> None:
    axes.set_title(plain(title), size=10, color=INK, loc="left", weight="bold", pad=5)
    axes.set_xlabel(x, size=8, color=SOFT, labelpad=2)
    axes.set_ylabel(y, size=8, color=SOFT, labelpad=2)


def _numbers(values: Sequence[float | None]) -> np.ndarray[Any, Any]:
    return np.array([math.nan if x is None else x for x in values])


def _energy(curves: Sequence[Curve], schemes: Mapping[str, int]) -> Figure:
    """Energy over time, and how far it is off."""
    plants = _plants(curves)
    figure, places = _grid(
        2, len(plants), (3.4, 2.3), "Energy of free motion",
        "released from rest, no control, no damping; above: energy, below: how far it is off; "
        "dashed: reference", schemes,
    )  # fmt: skip
    for column, plant in enumerate(plants):
        upper, lower = places[0][column], places[1][column]
        for curve in (c for c in curves if c["plant"] == plant):
            time, energy = _numbers(curve["time"]), _numbers(curve["energy"])
            style = _style(curve["integrator"], schemes)
            upper.semilogy(time, np.maximum(energy, 1e-6), **style)
            lower.semilogy(time, np.maximum(np.abs(energy - 1.0), 1e-16), **style)
        dt = next(c["dt"] for c in curves if c["plant"] == plant)
        upper.set_ylim(1e-3, 3e2)
        lower.set_ylim(1e-16, 1e3)
        _name(upper, f"{plant}, dt = {step(dt)} s", "time, s", "E / E at the start")
        _name(lower, "", "time, s", "|E / E at the start − 1|")
    return figure


def _phase(curves: Sequence[Curve], schemes: Mapping[str, int]) -> Figure:
    """Phase portraits, one for each plant and integrator, over the truth."""
    plants, names = _plants(curves), list(schemes)
    figure, places = _grid(
        len(plants), len(names), (1.75, 1.75), "Phase portraits of free motion",
        "released from rest, no control, no damping; grey band: reference", schemes,
    )  # fmt: skip
    for row, plant in enumerate(plants):
        found = {c["integrator"]: c for c in curves if c["plant"] == plant}
        for column, name in enumerate(names):
            axes = places[row][column]
            _portrait(axes, found[name], found.get(TRUTH), _style(name, schemes))
            unit = found[name]["units"][0]
            label = plain(str(found[name]["coordinate"]))
            _name(
                axes, name if row == 0 else "", f"{label}, {unit}",
                f"{plain(plant, 20)}: speed, {unit}/s" if column == 0 else "",
            )  # fmt: skip
            axes.title.set_fontsize(8.5)
    return figure


def _portrait(axes: Axes, curve: Curve, truth: Curve | None, style: Mapping[str, Any]) -> None:
    seen = truth or curve
    position, velocity = _numbers(seen["position"]), _numbers(seen["velocity"])
    middle = 0.5 * (np.nanmax(position) + np.nanmin(position))
    reach = 2.4 * max(np.nanmax(position) - middle, 1e-9)
    fastest = 2.4 * max(float(np.nanmax(np.abs(velocity))), 1e-9)
    if truth is not None:
        axes.plot(position, velocity, color=_SHADE, linewidth=4.0, solid_capstyle="round")
    axes.plot(_numbers(curve["position"]), _numbers(curve["velocity"]), **style)
    axes.set(xlim=(middle - reach, middle + reach), ylim=(-fastest, fastest))


def _convergence(curves: Sequence[Curve], schemes: Mapping[str, int]) -> Figure:
    """Error against step."""
    return _curves(
        curves, schemes, "steps", "Convergence",
        "largest error of (q, v/ω) in one driven period at a fixed control period; "
        "dotted: slopes 1, 2, 4",
        "step, s", _slopes,
    )  # fmt: skip


def _work(curves: Sequence[Curve], schemes: Mapping[str, int]) -> Figure:
    """Error against cost."""
    return _curves(
        curves, schemes, "evaluations_per_second", "Work and precision",
        "the same errors against cost; down and left is better",
        "evaluations of acceleration and Jacobian per simulated second", None,
    )  # fmt: skip


def _curves(
    curves: Sequence[Curve],
    schemes: Mapping[str, int],
    across: str,
    title: str,
    about: str,
    label: str,
    guides: Callable[[Axes, Sequence[Curve]], None] | None,
) -> Figure:
    plants = _plants(curves)
    figure, places = _grid(1, len(plants), (3.4, 3.2), title, about, schemes)
    for axes, plant in zip(places[0], plants, strict=True):
        own = [c for c in curves if c["plant"] == plant]
        for curve in own:
            name = curve["integrator"]
            axes.loglog(
                _numbers(curve[across]), _numbers(curve["errors"]),
                **_style(name, schemes), **_marker(name, schemes),
            )  # fmt: skip
        if guides is not None:
            guides(axes, own)
        _name(axes, plant, label, "error, rad or m")
    return figure


def _slopes(axes: Axes, curves: Sequence[Curve]) -> None:
    low, high = axes.get_ylim()
    steps = np.array([min(curves[0]["steps"]), max(curves[0]["steps"])])
    for order in (1, 2, 4):
        guide = high * 0.5 * (steps / steps[1]) ** order
        axes.loglog(steps, guide, color=SOFT, linewidth=0.7, linestyle=(0, (1, 2)), zorder=0.5)
    axes.set_ylim(low, high)


def _stability(curves: Sequence[Curve], schemes: Mapping[str, int]) -> Figure:
    """Growth per step of small oscillations against hω."""
    plants = _plants(curves)
    figure, places = _grid(
        1, len(plants), (3.4, 2.6), "Stability of small oscillations",
        "largest growth per step of any small motion at rest, against step × fastest frequency; "
        "above 1: unstable", schemes,
    )  # fmt: skip
    for axes, plant in zip(places[0], plants, strict=True):
        for curve in (c for c in curves if c["plant"] == plant):
            style = _style(curve["integrator"], schemes)
            axes.plot(_numbers(curve["h_omega"]), _numbers(curve["radius"]), **style)
        axes.set(ylim=(0.0, 3.0), xlim=(0.0, 4.0))
        _name(axes, plant, "hω", "growth per step")
    return figure


def _contact(curves: Sequence[Curve], schemes: Mapping[str, int]) -> Figure:
    """Rebound energy over step and stiffness, with the boundaries of stability."""
    plants, names = _plants(curves), list(schemes)
    figure, places = _grid(
        len(plants), len(names), (1.75, 1.75), "Contact: energy after one impact",
        "share left − analytic share; ink line: energy is gained above it; "
        "dashed: an oscillator grows above it", {},
    )  # fmt: skip
    mesh: Any = None
    for row, plant in enumerate(plants):
        found = {c["integrator"]: c for c in curves if c["plant"] == plant}
        for column, name in enumerate(names):
            axes, curve = places[row][column], found[name]
            mesh = _impact_map(axes, curve)
            _name(
                axes, name if row == 0 else "", f"stiffness, {curve['unit']}",
                f"{plain(plant, 20)}: step, s" if column == 0 else "",
            )  # fmt: skip
            axes.title.set_fontsize(8.5)
    high = float(figure.get_size_inches()[1])
    bar = figure.colorbar(
        mesh, cax=axes_at(figure, _LEFT, high - 1.0, 2.2, 0.12), orientation="horizontal"
    )
    bar.outline.set_visible(False)
    bar.set_ticks([-0.5, 0.0, 0.5], labels=["−0.5: drained", "exact", "+0.5: pumped"])
    bar.ax.tick_params(labelsize=7.5, colors=SOFT, length=0)
    return figure


def _impact_map(axes: Axes, curve: Curve) -> Any:
    from matplotlib.colors import LinearSegmentedColormap

    colours = LinearSegmentedColormap.from_list("error", (COOL, PAPER, WARM))
    stiffness, steps = _numbers(curve["stiffness"]), _numbers(curve["steps"])
    left = np.array([[math.inf if x is None else x for x in line] for line in curve["left"]])
    error = np.clip(left - curve["expected"], -_REBOUND, _REBOUND)
    across, up = _edges(stiffness), _edges(steps)
    axes.grid(visible=False)
    mesh = axes.pcolormesh(across, up, error, cmap=colours, vmin=-_REBOUND, vmax=_REBOUND)
    _boundary(axes, left > 1.0, across, up)
    theory = THEORY.get(curve["integrator"])
    if theory is not None and 0.0 < theory.oscillation_limit < math.inf:
        limit = theory.oscillation_limit / _numbers(curve["rates"])
        axes.plot(stiffness, limit, color=INK, linewidth=1.0, linestyle=(0, (3, 2)))
    axes.set(xscale="log", yscale="log", xlim=across[[0, -1]], ylim=up[[-1, 0]])
    axes.yaxis.set_minor_formatter("")
    return mesh


def _edges(centres: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Edges of cells around geometrically spaced centres."""
    ratio = math.sqrt(centres[1] / centres[0])
    edges: np.ndarray[Any, Any] = np.append(centres / ratio, centres[-1] * ratio)
    return edges


def _boundary(
    axes: Axes, inside: np.ndarray[Any, Any], across: np.ndarray[Any, Any],
    up: np.ndarray[Any, Any],
) -> None:  # fmt: skip
    """The line between cells that are inside and those that are not."""
    for row, column in np.argwhere(inside[:, 1:] != inside[:, :-1]):
        x = across[column + 1]
        axes.plot([x, x], up[row : row + 2], color=INK, linewidth=1.8)
    for row, column in np.argwhere(inside[1:] != inside[:-1]):
        y = up[row + 1]
        axes.plot(across[column : column + 2], [y, y], color=INK, linewidth=1.8)


def draw_drift(changes: Mapping[str, np.ndarray[Any, Any]], dt: float) -> Figure:
    """The largest energy change within each oscillation, over time, and its value at the end.

    Args:
        changes: relative energy change at every step, by integrator.
        dt: step, s.
    """
    schemes = _schemes(iter(changes))
    figure, places = _grid(
        1, 1, (5.8, 3.9), "Energy drift of a released pendulum",
        f"point mass, 0.5 rad from hanging, dt = {step(dt)} s; largest change within each "
        f"{_WINDOW:g} s; at the right, the change at the end", {}, top=1.0, margin=2.4,
    )  # fmt: skip
    axes, window = places[0][0], round(_WINDOW / dt)
    for name, change in changes.items():
        count = len(change) // window
        envelope = 100.0 * np.abs(change[: count * window]).reshape(count, window).max(axis=1)
        time = (np.arange(count) + 0.5) * _WINDOW
        style = _style(name, schemes)
        axes.semilogy(time, envelope, **style)
        label = f"{name}: {compact(100.0 * float(change[-1]), 3, True)} %"
        axes.annotate(
            label, (time[-1], envelope[-1]), xytext=(8, 0), textcoords="offset points",
            size=8.5, color=style["color"], va="center", annotation_clip=False,
        )  # fmt: skip
    axes.set_xlim(0.0, len(change) * dt)
    _name(axes, "", "time, s", "|energy change|, %")
    return figure


_FIGURES: Final[dict[str, tuple[str, Callable[[Sequence[Curve], Mapping[str, int]], Figure]]]] = {
    "energy.png": ("free_motion", _energy),
    "phase_portraits.png": ("free_motion", _phase),
    "stability.png": ("stiffness", _stability),
    "contact_stability.png": ("contact", _contact),
    "convergence.png": ("refinement", _convergence),
    "work_precision.png": ("refinement", _work),
}
