"""What figures for papers share: widths, the size of type, and axes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from integ_gym.support.figures import INK, LINE, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLUMN: Final = 3.35
"""Width of a column, inches: what IEEE, ACM and Elsevier have, to within 0.2."""

PAGE: Final = 6.9
"""Width of both columns of a page, inches."""

SIZE: Final = 8.0
"""Of all type, points."""

LETTER: Final = 0.063
"""Width of a letter of that size, inches."""

LINE_HEIGHT: Final = 0.155
"""Inches from line to line of type."""

TYPE: Final[dict[str, Any]] = {"size": SIZE, "color": INK}
"""Properties of a text, as Matplotlib takes them."""


def short(name: str, room: float) -> str:
    """Names of rows and cells with no more than they need, cut to a width in inches."""
    return plain(name.replace(" dt=", " "), int(room / LETTER))


def width_for(needed: float) -> float:
    """A column where that is enough, else the page, else what is needed, inches."""
    return next((width for width in (COLUMN, PAGE) if needed <= width), needed)


def framed(axes: Axes, across: str, up: str) -> None:
    """Label axes; with ticks, and without a frame above and at the right."""
    axes.set_xlabel(across, labelpad=2, **TYPE)
    axes.set_ylabel(up, labelpad=2, **TYPE)
    axes.tick_params(labelsize=SIZE, colors=INK, length=2.5, width=0.6, pad=2)
    axes.set_facecolor("none")
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set(color=INK, linewidth=0.6)
    axes.grid(color=LINE, linewidth=0.5)
    axes.set_axisbelow(True)
