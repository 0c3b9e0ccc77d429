"""One cell of a matrix, and the legend beneath it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from integ_gym.eval.figure_style import INK, PAPER, SOFT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH: Final = 0.62
"""Width of a cell, inches."""

HEIGHT: Final = 0.46
"""Height of a cell, inches."""


def box(axes: Axes, x: float, y: float, colour: str) -> None:
    """The cell's background."""
    from matplotlib.patches import Rectangle

    gap = 0.02
    size = WIDTH - 2 * gap, HEIGHT - 2 * gap
    axes.add_patch(Rectangle((x + gap, y + gap), *size, facecolor=colour, linewidth=0))


def home_frame(axes: Axes, x: float, y: float) -> None:
    """The frame of a cell that the row was trained in."""
    from matplotlib.patches import Rectangle

    for inset, colour, width in ((0.03, PAPER, 2.6), (0.008, INK, 1.9)):
        size = WIDTH - 2 * inset, HEIGHT - 2 * inset
        axes.add_patch(
            Rectangle((x + inset, y + inset), *size, fill=False, edgecolor=colour, linewidth=width)
        )


def cell_text(
    axes: Axes, x: float, y: float, text: str, colour: str, size: float = 9.5, up: float = 0.0
) -> None:
    """A text in the middle, moved by ``up`` inches."""
    axes.text(
        x + WIDTH / 2, y + HEIGHT / 2 - up, text, size=size, color=colour, ha="center",
        va="center_baseline" if up else "center", weight="normal",
    )  # fmt: skip


def ramp(axes: Axes, x: float, y: float, colour: Callable[[float], str]) -> None:
    """A colour scale one inch wide; ``colour`` takes shares in [0, 1]."""
    from matplotlib.patches import Rectangle

    parts = 60
    for part in range(parts):
        shade = colour((part + 0.5) / parts)
        place = (x + part / parts, y)
        axes.add_patch(Rectangle(place, 1.1 / parts, 0.13, facecolor=shade, linewidth=0))


def small(axes: Axes, x: float, y: float, text: str) -> None:
    """A small text that begins at a place."""
    axes.text(x, y, text, size=8, color=SOFT, ha="left", va="center")
