"""Figure of success: every row in every discretization."""

from __future__ import annotations

from typing import TYPE_CHECKING

from integ_gym.eval.colours import ink_on, success_colour
from integ_gym.eval.figure_style import INK
from integ_gym.eval.figures.cell import box, cell_text, home_frame, ramp, small
from integ_gym.eval.figures.matrix import draw_matrix
from integ_gym.eval.formatting import fixed
from integ_gym.eval.panel_model import Entry, Panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_success(panel: Panel) -> Figure | None:
    """Success rate of every row in every discretization."""
    if not panel.matrix:
        return None
    return draw_matrix(
        panel,
        "Success, trained on × evaluated on",
        "share of episodes that succeed, mean over training seeds; columns: step in seconds",
        _draw_cell,
        _legend,
    )


def _draw_cell(axes: Axes, x: float, y: float, entry: Entry, home: bool) -> None:
    rate = entry.success.estimate
    colour = success_colour(rate)
    ink = ink_on(colour)
    marks = {"false_pass": ["▲"], "false_fail": ["▽"]}.get(str(entry.reference_class), [])
    if entry.diverged:
        marks = [*marks, f"×{entry.diverged}"]
    box(axes, x, y, colour)
    if home:
        home_frame(axes, x, y)
    cell_text(axes, x, y, fixed(rate), ink, up=0.05 if marks else 0.0)
    if marks:
        cell_text(axes, x, y, " ".join(marks), ink, size=6.5, up=-0.13)


def _legend(axes: Axes, x: float, y: float) -> None:
    from matplotlib.patches import Rectangle

    small(axes, x, y, "0")
    ramp(axes, x + 0.15, y - 0.065, success_colour)
    small(axes, x + 1.2, y, "1")
    frame = (x + 1.5, y - 0.07)
    axes.add_patch(Rectangle(frame, 0.2, 0.14, fill=False, edgecolor=INK, linewidth=1.6))
    small(axes, x + 1.78, y, "trained here     ▲ false pass     ▽ false fail")
    small(axes, x, y + 0.24, "×n: episodes diverged. Pass: success of at least 0.5.")
