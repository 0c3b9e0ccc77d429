"""Figures of free motion: energy over time, and phase portraits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from integ_gym.envs.registries import TRUTH
from integ_gym.support.figures import SeriesStyles, plain
from integ_gym.support.terminal import step

from .drawing import Curve, curve_style, draw_grid, entries, named, numbers, plants_of, windows

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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
