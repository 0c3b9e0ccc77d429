"""Figure of energy residuals: every row in every discretization."""

from __future__ import annotations

from typing import TYPE_CHECKING

from integ_gym.eval.colours import ENERGY_FLOOR, symlog
from integ_gym.eval.figure_style import COOL, INK, SOFT, SUNK, WARM
from integ_gym.eval.figures.cell import box, cell_text, home_frame, ramp, small
from integ_gym.eval.figures.matrix import draw_matrix
from integ_gym.eval.formatting import compact
from integ_gym.eval.panel_model import Entry, Panel
from integ_gym.eval.report.matrices import largest_residual

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_energy(panel: Panel) -> Figure | None:
    """Energy residual of every row in every discretization."""
    largest = largest_residual(panel)
    if largest is None:
        return None
    floor = largest * ENERGY_FLOOR

    def draw(axes: Axes, x: float, y: float, entry: Entry, home: bool) -> None:
        _draw_cell(axes, x, y, entry, home, floor, largest)

    def legend(axes: Axes, x: float, y: float) -> None:
        _legend(axes, x, y, floor, largest)

    return draw_matrix(
        panel,
        "Energy that the numerics put in or took out",
        "energy residual, J per episode, mean over seeds; columns: step in seconds",
        draw,
        legend,
    )


def _draw_cell(
    axes: Axes, x: float, y: float, entry: Entry, home: bool, floor: float, largest: float
) -> None:
    residual = entry.energy_residual
    value = None if residual is None else residual.estimate
    if value is None:
        box(axes, x, y, SUNK)
    else:
        share = symlog(abs(value), floor, largest)
        box(axes, x, y, _tint(WARM if value > 0.0 else COOL, share))
    if home:
        home_frame(axes, x, y)
    text = compact(value, 2, True)
    cell_text(axes, x, y, text, SOFT if value is None else INK, size=6.8 if len(text) > 7 else 8)


def _legend(axes: Axes, x: float, y: float, floor: float, largest: float) -> None:
    def colour(share: float) -> str:
        return _tint(WARM if share > 0.5 else COOL, abs(2.0 * share - 1.0))

    ends = compact(largest)
    small(axes, x, y, f"−{ends} J")
    ramp(axes, x + 0.62, y - 0.065, colour)
    small(axes, x + 1.7, y, f"+{ends} J")
    small(axes, x, y + 0.24, f"symmetric logarithm, linear below {compact(floor)} J")


def _tint(colour: str, share: float) -> str:
    """A colour thinned with the paper's."""
    channels = (int(colour[place : place + 2], 16) for place in (1, 3, 5))
    return "#" + "".join(f"{round(255 + share * (value - 255)):02x}" for value in channels)
