"""What all figures share: lines and markers, and how a figure is begun and written.

Everything goes through `matplotlib.figure.Figure`: pyplot is never imported and no global setting
stays changed, so figures can be drawn in any process.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from ..files.writing import replace_file
from ..packages.extras import load
from .colours import PALETTE
from .series import MARKERS, SeriesStyle, SeriesStyles

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI: Final = 150
"""Dots per inch of every figure."""

BOLD: Final = 0.0098
"""Width of a bold letter, inches per point of its size."""

PAPER, SUNK, LINE, INK, SOFT, WARM, COOL = (
    PALETTE[name][0] for name in ("card", "sunk", "line", "ink", "soft", "warm", "cool")
)

FORMATS: Final[dict[str, dict[str, str | None]]] = {
    ".png": {"Software": "integ-gym"},
    ".svg": {"Creator": "integ-gym", "Date": None},
    ".pdf": {"Creator": "integ-gym", "Producer": None, "CreationDate": None},
}
"""Suffixes of the files of every figure, to what they say of themselves: nothing that changes."""


def write_figure(figure: Figure, path: Path) -> list[Path]:
    """Write a figure in every format; the same figure gives the same bytes.

    Args:
        figure: the figure.
        path: of the files, without a suffix.

    Returns:
        The files written, each complete as soon as it is there.
    """
    matplotlib = load("matplotlib", "report")
    written = []
    for suffix, metadata in FORMATS.items():
        buffer = io.BytesIO()
        with matplotlib.rc_context({"svg.hashsalt": "integ-gym", "pdf.fonttype": 42}):
            figure.savefig(buffer, format=suffix[1:], dpi=DPI, metadata=metadata)
        written.append(replace_file(path.with_name(path.name + suffix), buffer.getvalue()))
    return written


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


def fitting(lines: Sequence[str], width: float, size: float) -> float:
    """Size of text in points, at most ``size``, at which lines fit a width in inches, if bold."""
    return max(5.0, min(size, width / (BOLD * max(len(line) for line in lines))))


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


class Entry(NamedTuple):
    """One entry of a legend.

    Attributes:
        label: what it stands for.
        line: properties of the line, as Matplotlib takes them.
        marker: properties of the marker in the middle of it; None: no marker.
    """

    label: str
    line: Mapping[str, Any]
    marker: Mapping[str, Any] | None = None


def line_style(style: SeriesStyle, width: float = 1.6) -> dict[str, Any]:
    """Properties of a series' line, as Matplotlib takes them."""
    dashes = (0, style.dashes) if style.dashes else "-"
    return {"color": style.colour, "linewidth": width, "linestyle": dashes}


def marker_style(style: SeriesStyle) -> dict[str, Any]:
    """Properties of a series' marker, as Matplotlib takes them."""
    from matplotlib.path import Path as Outline

    corners = MARKERS[style.marker]
    reach = max(abs(place) for corner in corners for place in corner)
    edge = {"markeredgecolor": PAPER, "markeredgewidth": 0.6}
    closed = Outline([*corners, corners[0]], closed=True)
    return {"marker": closed, "markersize": 6.2 * reach, **edge}


def scheme_entries(schemes: SeriesStyles) -> list[Entry]:
    """One entry for each series."""
    return [
        Entry(name, line_style(style), {"color": style.colour, **marker_style(style)})
        for name, style in schemes.items()
    ]


def draw_legend(canvas: Axes, entries: Sequence[Entry], wide: float, y: float = 0.92) -> None:
    """Entries side by side, on as many lines as :func:`legend_lines` says."""
    for entry, (x, down) in zip(entries, _places(entries, wide), strict=True):
        at = y + down
        canvas.plot([x, x + 0.24], [at, at], **entry.line)
        if entry.marker is not None:
            canvas.plot([x + 0.12], [at], linestyle="none", **entry.marker)
        canvas.text(x + 0.3, at, plain(entry.label, 26), size=8, color=INK, va="center")


def legend_lines(entries: Sequence[Entry], wide: float) -> int:
    """Lines that a legend takes in a figure of a width in inches."""
    return 1 + round(max((down for _, down in _places(entries, wide)), default=0.0) / _LEGEND_LINE)


_LEGEND_LINE: Final = 0.2  # inches


def _places(entries: Sequence[Entry], wide: float) -> list[tuple[float, float]]:
    """Left edge of every entry, and how far down it is, in inches."""
    places, x, down = [], 0.3, 0.0
    for entry in entries:
        size = 0.42 + 0.066 * len(plain(entry.label, 26))
        if x + size > wide and x > 0.3:
            x, down = 0.3, down + _LEGEND_LINE
        places.append((x, down))
        x += size + 0.12
    return places
