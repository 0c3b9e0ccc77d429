"""Several episodes side by side: the plants as they move, and where their energy came from."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..episode.settings import Setup
from .bars import BAR, draw_bars
from .canvas import FAILS, GREEN, INK, MUTED, PAGE, WHITE, Canvas, Point
from .plants import drawing

_WIDTH = 300
"""Width of a pane, pixels."""
_HEADER, _TITLE, _GAP = 74, 58, 14
_MOST_COLUMNS = 4


@dataclass(frozen=True)
class Pane:
    """What stands still in the pane of one episode.

    Attributes:
        setup: of its environment.
        title: its discretization.
        note: in words, below the title.
        succeeds: how it ends.
    """

    setup: Setup
    title: str
    note: str
    succeeds: bool


@dataclass(frozen=True)
class Moment:
    """What moves in a pane.

    Attributes:
        state: true state, shape (n,), SI units.
        control: applied control.
        bars: name of an amount of energy to its value, J; NaN where it is not known.
    """

    state: npt.NDArray[np.float64]
    control: float
    bars: Mapping[str, float]


class Panes:
    """Draws episodes of one plant beside one another.

    Args:
        panes: of the episodes.
        heading: above all of them.
        note: below the heading.
        bars: how many each has.
        reach: least and greatest of all bars, J, which they are drawn to the scale of.
    """

    def __init__(
        self, panes: Sequence[Pane], heading: str, note: str, bars: int, reach: tuple[float, float]
    ) -> None:
        self._panes, self._heading, self._note = panes, heading, note
        self._low, self._high = min(0.0, reach[0]), max(1e-9, 0.0, reach[1])
        self._drawing = drawing(panes[0].setup.plant.name)
        self._shrink = (_WIDTH - 2 * _GAP) / self._drawing.size[0]
        rows = math.ceil(len(panes) / _MOST_COLUMNS)
        columns = math.ceil(len(panes) / rows)
        picture = self._shrink * self._drawing.size[1]
        self._pane_height = math.ceil(_TITLE + picture + bars * BAR + _GAP)
        width = max(2, columns) * (_WIDTH + _GAP) + _GAP
        size = width, _HEADER + rows * (self._pane_height + _GAP)
        self._canvas = Canvas(size, oversize=2)
        self._columns, self._bars = columns, bars

    def draw(self, moments: Sequence[Moment], time: float) -> npt.NDArray[np.uint8]:
        """One frame, shape (height, width, 3).

        Args:
            moments: one for each pane.
            time: since the start, s.
        """
        canvas = self._canvas
        canvas.clear()
        width, height = canvas.size
        canvas.box((width / 2, height / 2), (width, height), 0.0, PAGE)
        canvas.text(self._heading, (_GAP + 4, 26.0), 33, INK)
        canvas.text(self._note, (_GAP + 4, 54.0), 21, MUTED)
        canvas.text(f"{time:.1f} s", (width - _GAP - 4, 28.0), 33, INK, align=1.0)
        for place, (pane, moment) in enumerate(zip(self._panes, moments, strict=True)):
            row, column = divmod(place, self._columns)
            corner = _GAP + column * (_WIDTH + _GAP), _HEADER + row * (self._pane_height + _GAP)
            self._draw_pane(canvas.part(corner, (_WIDTH, self._pane_height), 1.0), pane, moment)
        return canvas.pixels()

    def _draw_pane(self, canvas: Canvas, pane: Pane, moment: Moment) -> None:
        width, height = canvas.size
        canvas.box((width / 2, height / 2), (width, height), 12.0, WHITE)
        canvas.text(pane.title, (_GAP, 24.0), 24, INK)
        canvas.text(pane.note, (_GAP, 47.0), 18, MUTED)
        _verdict(canvas, (width - _GAP, 24.0), pane.succeeds)
        picture = canvas.part((_GAP, _TITLE), self._drawing.size, self._shrink)
        state = [float(x) for x in moment.state]
        self._drawing.draw(picture, pane.setup, state, moment.control)
        top = height - _GAP / 2 - self._bars * BAR
        draw_bars(canvas, top, moment.bars, (self._low, self._high))


def _verdict(canvas: Canvas, end: Point, succeeds: bool) -> None:
    """A word and its mark, flush right."""
    x, y = end
    colour = GREEN if succeeds else FAILS
    canvas.text("succeeds" if succeeds else "fails", (x, y), 24, colour, align=1.0)
    x -= 92.0 if succeeds else 54.0
    tick = ((x - 5.0, y), (x - 1.0, y + 4.5), (x + 6.0, y - 5.0))
    cross = ((x - 5.0, y - 5.0), (x + 5.0, y + 5.0)), ((x - 5.0, y + 5.0), (x + 5.0, y - 5.0))
    for line in (tick[:2], tick[1:]) if succeeds else cross:
        canvas.line(*line, 3.0, colour)
