"""How the page draws what `report_data` describes."""

from __future__ import annotations

from integ_gym.support.figures import MARKERS, ink_on, success_colour

from .ladders import Series
from .matrices import Axis, Shade

LEFT, TOP, RIGHT, BOTTOM = 36.0, 12.0, 286.0, 176.0
"""Edges of a ladder's axes, in a frame of 300 by 212."""

ASIDE, SIZE = 2.6, 5.2
"""Width of a line and radius of a marker there."""


def along(axis: Axis, value: float) -> float:
    """Place of a value on an axis, in percent of the width."""
    return round(100.0 * axis.share(value), 2)


def across(share: float, series: Series | None = None) -> float:
    """Place of a step in a ladder's plot, moved aside as its series is."""
    aside = 0.0 if series is None else series.aside * ASIDE
    return round(LEFT + 22.0 + share * (RIGHT - LEFT - 40.0) + aside, 1)


def up(rate: float) -> float:
    """Place of a rate in a ladder's plot."""
    return round(BOTTOM - min(max(rate, 0.0), 1.0) * (BOTTOM - TOP), 1)


def corners(marker: str) -> str:
    """A marker about the origin, as the points of a polygon."""
    return " ".join(f"{SIZE * x:.1f},{-SIZE * y:.1f}" for x, y in MARKERS[marker])


def shading(shade: Shade) -> str:
    """Inline style of a matrix's cell."""
    if shade.tone == "rate":
        background = success_colour(shade.share)
        ends = [f"{100.0 * end:.0f}%" for end in shade.span or ()]
        whisker = f";--l:{ends[0]};--h:{ends[1]}" if ends else ""
        return f"background-color:{background};color:{ink_on(background)}{whisker}"
    return "" if shade.tone == "empty" else f"--a:{shade.share:.3f}"
