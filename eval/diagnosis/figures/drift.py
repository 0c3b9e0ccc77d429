"""The figure of the worked example of energy drift."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from integ_gym.support.figures import line_style
from integ_gym.support.terminal import compact_percent, step

from ...scheme_style import styles_of
from .drawing import draw_grid, named, windows

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WINDOW: Final = 2.0
"""What the largest change is taken over, s: about one oscillation of the worked example."""


def draw_drift(changes: Mapping[str, np.ndarray[Any, Any]], dt: float) -> Figure:
    """The largest energy change within each oscillation, over time, and its value at the end.

    Args:
        changes: relative energy change at every step, by integrator.
        dt: step, s.
    """
    styles = styles_of(changes)
    heading = (
        "Energy drift of a released pendulum",
        f"point mass, 0.5 rad from hanging, dt = {step(dt)} s; largest change within each "
        f"{WINDOW:g} s; at the right, the change at the end",
    )
    figure, ((axes,),) = draw_grid(heading, (), (1, 1), (5.8, 3.9), right=2.4, legible=0.25)
    window = round(WINDOW / dt)
    for name, change in changes.items():
        envelope = 100.0 * windows(np.abs(change), window).max(axis=1)
        time = (np.arange(len(envelope)) + 0.5) * WINDOW
        style = styles[name]
        axes.semilogy(time, envelope, **line_style(style, 1.3))
        label = f"{name}: {compact_percent(float(change[-1]), 3, sign=True)}"
        axes.annotate(
            label, (time[-1], envelope[-1]), xytext=(8, 0), textcoords="offset points",
            size=8.5, color=style.colour, va="center", annotation_clip=False,
        )  # fmt: skip
    axes.set_xlim(0.0, len(change) * dt)
    named(axes, "", "time, s", "|energy change|, %")
    return figure
