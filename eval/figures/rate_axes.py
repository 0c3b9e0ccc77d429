"""Axes of success rates beside lines of text."""

from __future__ import annotations

from typing import TYPE_CHECKING

from integ_gym.eval.figure_style import LINE, axes_at, bare

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def rate_axes(figure: Figure, left: float, top: float, width: float, tall: float) -> Axes:
    """Axes of rates whose upper left corner is at a place in inches, y in inches downwards."""
    high = float(figure.get_size_inches()[1])
    axes = axes_at(figure, left, high - top - tall, width, tall)
    axes.set(xlim=(-0.02, 1.02), ylim=(tall, 0.0), yticks=[])
    axes.set_xticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0", "0.25", "0.5", "0.75", "1"])
    axes.grid(axis="x", color=LINE, linewidth=0.7)
    axes.set_axisbelow(True)
    bare(axes)
    return axes
