"""What all figures share: colours, markers, and how a figure is begun and written.

Everything goes through `matplotlib.figure.Figure` and the Agg canvas: pyplot is never imported
and no global setting is changed, so figures can be drawn in any process.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Final

from integ_gym.envs.extras import load

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI: Final = 150
"""Dots per inch of every figure."""

INK, SOFT, LINE, PAPER, SUNK = "#14171c", "#565c66", "#dedfd9", "#ffffff", "#efefeb"
WARM, COOL = "#e8783c", "#5492d6"
ACCENT: Final = "#2f4fb5"

SCHEME_COLOURS: Final = (
    "#c44e00", "#0067a5", "#008060", "#a8437c", "#8a6d00", "#6b9400", "#5b5f97",
)  # fmt: skip
"""Colours of integrators; markers tell them apart as well."""

SCHEME_MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X")
"""Markers of integrators."""


def png(figure: Figure) -> bytes:
    """A figure as the content of a PNG file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    buffer = io.BytesIO()
    FigureCanvasAgg(figure)
    figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": "integ-gym"})
    return buffer.getvalue()


def blank_figure(width: float, height: float) -> Figure:
    """An empty figure of a size in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=DPI, facecolor=PAPER)


def axes_at(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Axes at a place in inches from the lower left corner."""
    wide, high = figure.get_size_inches()
    return figure.add_axes((left / wide, bottom / high, width / wide, height / high))


def inch_canvas(figure: Figure) -> Axes:
    """Axes over the whole figure whose unit is one inch, y downwards."""
    wide, high = (float(size) for size in figure.get_size_inches())
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, wide), ylim=(high, 0.0))
    axes.axis("off")
    return axes


@cache
def _known_characters() -> frozenset[int]:
    """Characters that the default font can draw."""
    manager = load("matplotlib.font_manager", "report")
    font = manager.get_font(manager.findfont(manager.FontProperties()))
    return frozenset(font.get_charmap())


def plain(text: str, longest: int = 46) -> str:
    """Text as it is drawn: no mathematics, no character the font lacks, not too long."""
    known = _known_characters()
    drawn = "".join(letter if ord(letter) in known else "?" for letter in " ".join(text.split()))
    if len(drawn) > longest:
        drawn = drawn[: longest - 1] + "…"
    return drawn.replace("$", r"\$")


def draw_heading(axes: Axes, left: float, title: str, about: str) -> None:
    """A figure's heading: what it shows, and how to read it."""
    axes.text(left, 0.36, title, size=14, weight="bold", color=INK, va="baseline")
    axes.text(left, 0.62, about, size=9, color=SOFT, va="baseline")


def bare(axes: Axes) -> None:
    """No frame but the lower edge."""
    for side in ("left", "right", "top"):
        axes.spines[side].set_visible(False)
    axes.spines["bottom"].set_color(LINE)
    axes.tick_params(axis="both", colors=SOFT, labelsize=8, length=0)
    axes.set_facecolor("none")


def scheme_legend(canvas: Axes, schemes: Mapping[str, int], wide: float, y: float = 0.92) -> None:
    """One entry for each integrator, on as many lines as it takes."""
    x = 0.3
    for name, place in schemes.items():
        text = plain(name, 26)
        size = 0.42 + 0.066 * len(text)
        if x + size > wide:
            x, y = 0.3, y + 0.2
        style = place % len(SCHEME_COLOURS)
        colour, marker = SCHEME_COLOURS[style], SCHEME_MARKERS[style]
        canvas.plot([x, x + 0.24], [y, y], color=colour, linewidth=1.6)
        canvas.plot(x + 0.12, y, marker, color=colour, markersize=5)
        canvas.text(x + 0.3, y, text, size=8, color=INK, va="center")
        x += size + 0.12
