"""How figures look: colours, markers, and the style of plots."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

from .files import replace_file
from .optional import load

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


PALETTE: Final = {
    "page": ("#f6f6f3", "#0d1015"),
    "card": ("#ffffff", "#161a21"),
    "sunk": ("#efefeb", "#1f242d"),
    "line": ("#dedfd9", "#2d343f"),
    "ink": ("#14171c", "#eceef2"),
    "soft": ("#565c66", "#a2a9b5"),
    "accent": ("#2f4fb5", "#9db4ff"),
    "fails": ("#b8400a", "#ff9966"),
    "transfers": ("#00724f", "#4fd0a5"),
    "inconclusive": ("#7a5a00", "#e6c15c"),
    "not_learned": ("#626873", "#a5acb8"),
    "warm": ("#e8783c", "#be541c"),
    "cool": ("#5492d6", "#2664aa"),
}
"""What a colour is for, to the colours on light and on dark ground."""

AMOUNTS: Final = {
    "start": ("accent", "accent"),
    "motor": ("soft", "soft"),
    "numerics": ("warm", "cool"),
    "losses": ("inconclusive", "inconclusive"),
    "energy": ("ink", "ink"),
}
"""Amount of energy to the names of its colours in :data:`PALETTE`, above and below zero, in the
order in which bars show them."""

VIRIDIS: Final = (
    "440154", "48186a", "472d7b", "424086", "3b528b", "33638d", "2c728e", "26828e", "21918c",
    "1fa088", "28ae80", "3fbc73", "5ec962", "84d44b", "addc30", "d8e219", "fde725",
)  # fmt: skip
"""Stops of the map for success, from 0 to 1: perceptually uniform, safe for the colour-blind."""

ENERGY_FLOOR: Final = 1e-4
"""Share of the largest energy residual below which its scale is linear."""


def success_colour(rate: float) -> str:
    """Colour of a success rate, as ``#rrggbb``."""
    place = min(max(rate, 0.0), 1.0) * (len(VIRIDIS) - 1)
    below = min(int(place), len(VIRIDIS) - 2)
    return mixed(f"#{VIRIDIS[below]}", f"#{VIRIDIS[below + 1]}", place - below)


def mixed(one: str, other: str, share: float) -> str:
    """The colour at a share in [0, 1] of the way between two ``#rrggbb`` colours."""
    pairs = zip(channels(one), channels(other), strict=True)
    return "#" + "".join(f"{round(a + share * (b - a)):02x}" for a, b in pairs)


def ink_on(background: str) -> str:
    """Black or white, whichever reads better on a ``#rrggbb`` background (WCAG contrast)."""
    linear = [
        channel / 12.92 if channel <= 0.04045 else ((channel + 0.055) / 1.055) ** 2.4
        for channel in (value / 255.0 for value in channels(background))
    ]
    luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
    return "#000000" if (luminance + 0.05) / 0.05 > 1.05 / (luminance + 0.05) else "#ffffff"


def channels(colour: str) -> tuple[int, int, int]:
    """Red, green and blue of a ``#rrggbb`` colour, 0 to 255."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def symlog(value: float, floor: float, largest: float) -> float:
    """Share in [0, 1] of a size on a logarithmic scale that is linear below ``floor``."""
    if largest <= 0.0 or floor <= 0.0:
        return 0.0
    return math.asinh(value / floor) / math.asinh(largest / floor)


HUES: Final = {
    "vermilion": ("#b84700", "#f2762e"),
    "blue": ("#004d85", "#2f86d6"),
    "green": ("#007a58", "#22b98c"),
    "purple": ("#b95b94", "#d984b8"),
    "orange": ("#c98a00", "#f5d24a"),
    "sky": ("#3399d4", "#9bdcff"),
    "ink": PALETTE["ink"],
}
"""Name to colours on light and on dark ground: those of Okabe and Ito, made as dark or as light as
the ground asks for, and apart for every kind of colour-blindness."""


def _star(count: int, turn: float, inner: float) -> tuple[tuple[float, float], ...]:
    """A star, first point at ``turn`` degrees, of the area 2; ``inner``: its smaller radius."""
    corners, between = 2 * count, math.pi / count
    outer = math.sqrt(2.0 / (count * inner * math.sin(between)))
    radii = [outer * (inner if k % 2 else 1.0) for k in range(corners)]
    angles = [math.radians(turn) + between * k for k in range(corners)]
    return tuple((r * math.cos(a), r * math.sin(a)) for r, a in zip(radii, angles, strict=True))


def _polygon(count: int, turn: float) -> tuple[tuple[float, float], ...]:
    """A regular polygon, first corner at ``turn`` degrees, of the area 2."""
    return _star(count, turn, math.cos(math.pi / count))[::2]


MARKERS: Final = {
    "circle": _polygon(24, 0.0),
    "square": _polygon(4, 45.0),
    "triangle": _polygon(3, 90.0),
    "diamond": _polygon(4, 90.0),
    "down": _polygon(3, -90.0),
    "star": _star(5, 90.0, 0.45),
    "cross": _star(4, 45.0, 0.4),
    "plus": _star(4, 90.0, 0.4),
    "left": _polygon(3, 180.0),
    "right": _polygon(3, 0.0),
}
"""Name to corners (x, y), y upwards."""

DASHES: Final = ((), (5.0, 2.0), (2.0, 1.5))
"""Lengths of strokes and gaps, in widths of the line; none: a whole line."""


@dataclass(frozen=True)
class SeriesStyle:
    """How one series of a plot is drawn.

    Attributes:
        hue: one of :data:`HUES`.
        marker: one of :data:`MARKERS`.
        dashes: one of :data:`DASHES`.
    """

    hue: str
    marker: str
    dashes: tuple[float, ...] = ()

    @property
    def colour(self) -> str:
        """On light ground, as ``#rrggbb``."""
        return HUES[self.hue][0]


SeriesStyles: TypeAlias = Mapping[str, SeriesStyle]
"""Style of every series that something shows, by its name."""


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


def draw_legend(
    canvas: Axes,
    entries: Sequence[Entry],
    wide: float,
    y: float = 0.92,
    *,
    left: float = 0.3,
    gap: float = 0.12,
    pitch: float = 0.2,
    scale: float = 1.0,
) -> None:
    """Entries side by side, on as many lines as :func:`legend_lines` says.

    Args:
        canvas: see :func:`inch_canvas`.
        entries: of the legend.
        wide: width of the figure, inches.
        y: of the first line, inches.
        left: edge of the legend, inches.
        gap: between two entries, inches.
        pitch: from line to line, inches.
        scale: factor on the size of markers.
    """
    for entry, (x, down) in zip(entries, _places(entries, wide, left, gap), strict=True):
        at = y + pitch * down
        canvas.plot([x, x + 0.24], [at, at], **entry.line)
        if entry.marker is not None:
            marker = {**entry.marker, "markersize": scale * entry.marker["markersize"]}
            canvas.plot([x + 0.12], [at], linestyle="none", **marker)
        canvas.text(x + 0.3, at, plain(entry.label, 26), size=8, color=INK, va="center")


def legend_lines(
    entries: Sequence[Entry], wide: float, left: float = 0.3, gap: float = 0.12
) -> int:
    """Lines that a legend takes in a figure, see :func:`draw_legend`."""
    return 1 + max((down for _, down in _places(entries, wide, left, gap)), default=0)


def _places(
    entries: Sequence[Entry], wide: float, left: float, gap: float
) -> list[tuple[float, int]]:
    """Left edge of every entry, inches, and its line."""
    places, x, down = [], left, 0
    for entry in entries:
        size = 0.3 + gap + 0.066 * len(plain(entry.label, 26))
        if x + size > wide and x > left:
            x, down = left, down + 1
        places.append((x, down))
        x += size + gap
    return places
