"""Figures of errors over step and cost, and of stability."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from integ_gym.envs.registries import TRUTH
from integ_gym.support.figures import (
    INK,
    SOFT,
    Entry,
    SeriesStyles,
    line_style,
    marker_style,
    write_figure,
)
from integ_gym.support.optional import load
from integ_gym.support.terminal import compact_percent, step

from ..scheme_style import styles_of
from .drawing import (
    Curve,
    curve_style,
    draw_contact,
    draw_energy,
    draw_grid,
    draw_phase,
    entries,
    named,
    numbers,
    plants_of,
    schemes_of,
    windows,
)
from .subject import theory_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_MOST_COLUMNS: Final = 3
_SMALLEST: Final = 1e-16
_WIDEST: Final = 6.3  # hω


def draw_convergence(curves: Sequence[Curve], schemes: SeriesStyles) -> Figure:
    """Error against step."""
    return _curves(
        curves, schemes, "steps", "Convergence",
        "largest error in one driven period at a fixed control period, against the truth; the "
        "truth's own error is against SciPy's DOP853",
        "step, s", entries(schemes), _orders,
    )  # fmt: skip


def draw_work(curves: Sequence[Curve], schemes: SeriesStyles) -> Figure:
    """Error against cost."""
    star = {"color": INK, "marker": "*", "markersize": 9}
    legend = [*entries(schemes)[:-1], Entry(TRUTH, {"color": INK, "linewidth": 0.0}, star)]
    return _curves(
        curves, schemes, "evaluations_per_second", "Work and precision",
        "the same errors against evaluations of accelerations and Jacobians, from coarse to fine "
        "steps; down and left is better",
        "evaluations per simulated second", legend, None,
    )  # fmt: skip


def _curves(
    curves: Sequence[Curve],
    schemes: SeriesStyles,
    across: str,
    title: str,
    about: str,
    label: str,
    legend: Sequence[Entry],
    guides: Callable[[Axes, Sequence[Curve]], None] | None,
) -> Figure:
    """One plot for every coordinate of every plant."""
    shown = list(dict.fromkeys((c["plant"], c["coordinate"]) for c in curves))
    columns = min(len(shown), _MOST_COLUMNS)
    rows = math.ceil(len(shown) / columns)
    figure, places = draw_grid((title, about), legend, (rows, columns), (3.4, 2.9))
    for axes, (plant, coordinate) in zip(places.flat, shown, strict=False):
        own = [c for c in curves if (c["plant"], c["coordinate"]) == (plant, coordinate)]
        for curve in own:
            _curve(axes, curve, across, schemes)
        if guides is not None:
            guides(axes, own)
        named(axes, f"{plant}: {coordinate}", label, f"error of {coordinate}, {own[0]['unit']}")
        axes.minorticks_off()
    for axes in places.flat[len(shown) :]:
        axes.set_visible(False)
    return figure


def _curve(axes: Axes, curve: Curve, across: str, schemes: SeriesStyles) -> None:
    name, errors = curve["integrator"], np.maximum(numbers(curve["errors"]), _SMALLEST)
    if name != TRUTH:
        style = {**curve_style(name, schemes), **marker_style(schemes[name])}
        axes.loglog(numbers(curve[across]), errors, **style)
    elif across == "steps":
        axes.axhline(errors[0], **curve_style(name, schemes))
    else:
        axes.loglog(numbers(curve[across]), errors, "*", color=INK, markersize=9, zorder=5)


def _orders(axes: Axes, curves: Sequence[Curve]) -> None:
    """A line of every declared slope below the most accurate curve that has it."""
    best: dict[int, tuple[float, Curve]] = {}
    for curve in curves:
        order, error = curve["order"], numbers(curve["errors"])[0]
        if curve["integrator"] == TRUTH or order is None or not np.isfinite(error):
            continue
        if order not in best or error < best[order][0]:
            best[order] = (error, curve)
    low, high = axes.get_ylim()
    for order, (error, curve) in best.items():
        steps = numbers(curve["steps"])
        guide = 0.3 * error * (steps / steps[0]) ** order
        axes.loglog(steps, guide, color=SOFT, linewidth=0.8, linestyle=(0, (1, 2)), zorder=0.5)
        axes.annotate(
            f"slope {order}", (steps[-2], guide[-2]), xytext=(3, -3),
            textcoords="offset points", size=7, color=SOFT, va="top",
        )  # fmt: skip
    axes.set_ylim(max(0.3 * low, 0.1 * _SMALLEST), high)


def draw_stability(curves: Sequence[Curve], schemes: SeriesStyles) -> Figure:
    """Growth per step of small oscillations against hω."""
    plants = plants_of(curves)
    heading = (
        "Stability of small oscillations",
        "growth per step against step × fastest frequency: line, any motion, one step linearized "
        "at rest; marker, the fastest oscillation, followed; above 1: growth",
    )
    figure, places = draw_grid(heading, entries(schemes), (1, len(plants)), (3.6, 2.8))
    for axes, plant in zip(places[0], plants, strict=True):
        axes.axhline(1.0, **curve_style(TRUTH, schemes))
        for curve in (c for c in curves if c["plant"] == plant and c["integrator"] != TRUTH):
            _growth(axes, curve, schemes)
        _limits(axes, [c["integrator"] for c in curves if c["plant"] == plant])
        axes.set(ylim=(0.0, 3.0), xlim=(0.0, _WIDEST))
        named(axes, plant, "hω", "factor on the amplitude per step")
    return figure


def _growth(axes: Axes, curve: Curve, schemes: SeriesStyles) -> None:
    name = curve["integrator"]
    style = curve_style(name, schemes)
    axes.plot(numbers(curve["h_omega"]), numbers(curve["radius"]), **style)
    markers = {**marker_style(schemes[name]), "color": style["color"], "linestyle": "none"}
    axes.plot(numbers(curve["followed"]), numbers(curve["growth"]), zorder=3, **markers)


def _limits(axes: Axes, names: Sequence[str]) -> None:
    """What theory says of where growth begins."""
    for limit in {t.oscillation_limit for name in names if (t := theory_of(name)) is not None}:
        if not 0.0 < limit < math.inf:
            continue
        axes.axvline(limit, color=SOFT, linewidth=0.8, linestyle=(0, (1, 2)), zorder=0.5)
        axes.annotate(
            f"limit {limit:.3g}", (limit, 0.0), xytext=(3, 4), textcoords="offset points",
            size=7, color=SOFT,
        )  # fmt: skip


WINDOW: Final = 2.0
"""What the largest change is taken over, s: about one oscillation of the worked example."""


def draw_drift(changes: Mapping[str, np.ndarray[Any, Any]], dt: float) -> Figure:
    """The largest energy change within each oscillation, over time, and its value at the end.

    Args:
        changes: relative energy change at every step, by integrator.
        dt: step, s.
    """
    styles = styles_of(changes)
    heading = (
        "Energy drift of a released pendulum",
        f"point mass, 0.5 rad from hanging, dt = {step(dt)} s; largest change within each "
        f"{WINDOW:g} s; at the right, the change at the end",
    )
    figure, ((axes,),) = draw_grid(heading, (), (1, 1), (5.8, 3.9), right=2.4, legible=0.25)
    window = round(WINDOW / dt)
    for name, change in changes.items():
        envelope = 100.0 * windows(np.abs(change), window).max(axis=1)
        time = (np.arange(len(envelope)) + 0.5) * WINDOW
        style = styles[name]
        axes.semilogy(time, envelope, **line_style(style, 1.3))
        label = f"{name}: {compact_percent(float(change[-1]), 3, sign=True)}"
        axes.annotate(
            label, (time[-1], envelope[-1]), xytext=(8, 0), textcoords="offset points",
            size=8.5, color=style.colour, va="center", annotation_clip=False,
        )  # fmt: skip
    axes.set_xlim(0.0, len(change) * dt)
    named(axes, "", "time, s", "|energy change|, %")
    return figure


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
    schemes = schemes_of(result["integrators"])
    for name, (key, draw) in FIGURES.items():
        found = result["curves"].get(key)
        if found:
            written += write_figure(draw(found, schemes), directory / name)
    impacts = result["curves"].get("contact", [])
    for plant in plants_of(impacts):
        own = [c for c in impacts if c["plant"] == plant]
        name = f"contact_{re.sub(r'[^A-Za-z0-9._]+', '-', plant)}"
        written += write_figure(draw_contact(own, schemes), directory / name)
    return written


FIGURES: Final[dict[str, tuple[str, Callable[[Sequence[Curve], SeriesStyles], Figure]]]] = {
    "energy": ("free_motion", draw_energy),
    "phase_portraits": ("free_motion", draw_phase),
    "stability": ("stiffness", draw_stability),
    "convergence": ("refinement", draw_convergence),
    "work_precision": ("refinement", draw_work),
}
