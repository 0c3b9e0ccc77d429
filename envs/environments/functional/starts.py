"""The box in which a task draws its starts."""

from __future__ import annotations

from itertools import repeat

from ...arithmetic import Components
from ...episode import GivenNumbers, Setup


def start_range(setup: Setup) -> tuple[Components, Components]:
    """Lowest and highest start, in state order, SI units.

    Starts are drawn uniformly in a box, so its corners are what the task makes of the ends of all
    its draws.
    """
    task, start = setup.task, setup.settings.start
    corners = (task.draw_start(GivenNumbers(repeat(x)), start, {}) for x in (0.0, 1.0))
    low, high = corners
    return low, high
