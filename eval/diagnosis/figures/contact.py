"""The figure of contact: one impact over step and stiffness, and where it gains energy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from integ_gym.support.figures import (
    COOL,
    INK,
    PAPER,
    SOFT,
    WARM,
    Entry,
    SeriesStyles,
    axes_at,
)

from ..bench.integrators import theory_of
from .drawing import Curve, draw_grid, named, numbers

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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
