"""Amounts of energy over time, as lines."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.support.terminal import fixed

from ..settings import Setup
from .canvas import (
    BAR,
    BLUE,
    FAILS,
    FAINT,
    GREEN,
    INK,
    MUTED,
    PAGE,
    VERMILION,
    WHITE,
    Canvas,
    Point,
    colour_of,
    draw_bars,
    tint,
)
from .plants import find_drawing

_EDGE, _SCALE, _HEAD, _FOOT = 14.0, 56.0, 10.0, 22.0
_TICKS = 4
_POINTS = 160
"""Of a line, at most; it is as wide as about twice as many pixels."""


@dataclass(frozen=True)
class Course:
    """What was, up to now.

    Attributes:
        times: s, increasing.
        amounts: name to values at these times, J.
        marks: times at which something was changed, s.
        goal: energy that is to be reached, J, or None.
    """

    times: Sequence[float]
    amounts: Mapping[str, Sequence[float]]
    marks: Sequence[float] = ()
    goal: float | None = None


def draw_course(canvas: Canvas, course: Course, seconds: float) -> None:
    """Draw the last seconds of a course over the whole canvas, the present at the right edge."""
    width, height = canvas.size
    end = max(seconds, course.times[-1])
    low, high, tick = _scale_of(course)
    across = (width - _EDGE - _SCALE) / seconds
    upwards = (height - _HEAD - _FOOT) / (high - low)

    def place(time: float, value: float) -> Point:
        x = _SCALE + across * max(0.0, time - end + seconds)
        return x, height - _FOOT - upwards * (min(high, max(low, value)) - low)

    for k in range(round((high - low) / tick) + 1):
        value = low + k * tick
        left, right = place(end - seconds, value), place(end, value)
        canvas.line(left, right, 1.5 if value else 2.5, FAINT, rounded=False)
        canvas.text(f"{fixed(value, max(0, -math.floor(math.log10(tick))))} J",
                    (_SCALE - 6.0, left[1]), 17, MUTED, align=1.0)  # fmt: skip
    for mark in course.marks:
        if mark > end - seconds:
            canvas.line(place(mark, low), place(mark, high), 1.0, BLUE, rounded=False)
    if course.goal is not None:
        left, right = place(end - seconds, course.goal), place(end, course.goal)
        canvas.line(left, right, 1.5, GREEN, rounded=False)
        canvas.text("goal", (right[0] - 4.0, right[1] - 8.0), 17, GREEN, align=1.0)
    every = -(-len(course.times) // _POINTS)
    for name, values in course.amounts.items():
        pairs = list(zip(course.times, values, strict=True))
        points = [place(*pair) for pair in (*pairs[:-1:every], pairs[-1])]
        for one, other in pairwise(points):
            canvas.line(one, other, 2.5, colour_of(name), rounded=False)
    for text, x, align in ((f"{end - seconds:.0f} s", _SCALE, 0.0), (f"{end:.0f} s", width, 1.0)):
        canvas.text(text, (x - align * _EDGE, height - 9.0), 17, INK, align=align)


def _scale_of(course: Course) -> tuple[float, float, float]:
    """Least and greatest value of an axis that holds a course, and the step between its ticks."""
    values = [value for amounts in course.amounts.values() for value in amounts]
    values += [0.0, 1.0, *([] if course.goal is None else [1.2 * course.goal])]
    least = min(values)
    span = max(values) - least
    power = 10.0 ** math.floor(math.log10(span / _TICKS))
    tick = next(power * n for n in (1.0, 2.0, 5.0, 10.0) if power * n * _TICKS >= span)
    return tick * math.floor(least / tick), tick * math.ceil(max(values) / tick), tick


_WIDTH = 300
"""Width of a pane, pixels."""
_HEADER, _TITLE, _GAP = 74, 58, 14
_CLOCK = 80
"""Width of what tells the time, pixels."""
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
        controls: those applied.
        bars: name of an amount of energy to its value, J; NaN where it is not known.
    """

    state: npt.NDArray[np.float64]
    controls: Sequence[float]
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
        self._drawing = find_drawing(panes[0].setup.plant.name)
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
        canvas.clear(PAGE)
        width, _ = canvas.size
        beside = canvas.part((0.0, 0.0), (width - _CLOCK, _HEADER), 1.0)
        beside.text(self._heading, (_GAP + 4, 26.0), 33, INK)
        canvas.text(self._note, (_GAP + 4, 54.0), 21, MUTED)
        canvas.text(f"{time:.1f} s", (width - _GAP - 4, 28.0), 33, INK, align=1.0)
        for place, (pane, moment) in enumerate(zip(self._panes, moments, strict=True)):
            row, column = divmod(place, self._columns)
            corner = _GAP + column * (_WIDTH + _GAP), _HEADER + row * (self._pane_height + _GAP)
            self._draw_pane(canvas.part(corner, (_WIDTH, self._pane_height), 1.0), pane, moment)
        return canvas.pixels()

    def _draw_pane(self, canvas: Canvas, pane: Pane, moment: Moment) -> None:
        _card(canvas)
        width, height = canvas.size
        canvas.text(pane.title, (_GAP, 24.0), 24, INK)
        canvas.text(pane.note, (_GAP, 47.0), 18, MUTED)
        _verdict(canvas, (width - _GAP, 24.0), pane.succeeds)
        picture = canvas.part((_GAP, _TITLE), self._drawing.size, self._shrink)
        state = [float(x) for x in moment.state]
        self._drawing.draw(picture, pane.setup, state, moment.controls)
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


_SIZE = (1000, 640)
_CARD_GAP, _TOP, _CARD = 14.0, 60.0, 500.0
_LEFT = 480.0
_LINE = 23.0
SHOWN = 20.0
"""How much of the past is shown, s."""


@dataclass(frozen=True)
class Choice:
    """Things to choose from.

    Attributes:
        title: what they are.
        names: of all of them.
        chosen: place of the one that is chosen.
    """

    title: str
    names: Sequence[str]
    chosen: int


@dataclass(frozen=True)
class View:
    """What a cockpit shows.

    Attributes:
        title: what runs.
        warning: what is wrong with it; empty if nothing is.
        time: since the start, s.
        moment: what moves, with the amounts of energy as bars.
        choices: from left to right.
        course: amounts of energy up to now.
    """

    title: str
    warning: str
    time: float
    moment: Moment
    choices: Sequence[Choice]
    course: Course


class Cockpit:
    """Draws views of one plant.

    Args:
        setup: has the plant and the task.
        help_lines: what keys do, below everything.
    """

    def __init__(self, setup: Setup, help_lines: Sequence[str]) -> None:
        self._setup, self._help = setup, help_lines
        self._drawing = find_drawing(setup.plant.name)
        self._canvas = Canvas(_SIZE, oversize=2)

    def frame(self, view: View) -> Any:
        """The picture as a ``pygame.Surface``, overwritten by the next call."""
        self._draw(view)
        return self._canvas.frame()

    def pixels(self, view: View) -> npt.NDArray[np.uint8]:
        """The same as an array, shape (height, width, 3)."""
        self._draw(view)
        return self._canvas.pixels()

    def _draw(self, view: View) -> None:
        canvas = self._canvas
        canvas.clear(PAGE)
        width, _ = canvas.size
        canvas.text(view.title, (_CARD_GAP + 4, 32.0), 34, INK)
        canvas.text(f"{view.time:.1f} s", (width - _CARD_GAP - 4, 32.0), 34, INK, align=1.0)
        self._draw_plant(canvas.part((_CARD_GAP, _TOP), (int(_LEFT), int(_CARD)), 1.0), view)
        right = int(width - _LEFT - 3 * _CARD_GAP)
        self._draw_energy(
            canvas.part((_LEFT + 2 * _CARD_GAP, _TOP), (right, int(_CARD)), 1.0), view
        )
        for row, line in enumerate(self._help):
            canvas.text(line, (_CARD_GAP + 4, _TOP + _CARD + 28.0 + row * 26.0), 21, MUTED)

    def _draw_plant(self, canvas: Canvas, view: View) -> None:
        _card(canvas)
        width, height = canvas.size
        shrink = (width - 2 * _CARD_GAP) / self._drawing.size[0]
        top = (height - shrink * self._drawing.size[1]) / 2
        picture = canvas.part((_CARD_GAP, top), self._drawing.size, shrink)
        state = [float(x) for x in view.moment.state]
        self._drawing.draw(picture, self._setup, state, view.moment.controls)
        canvas.text(view.warning, (width / 2, 24.0), 24, VERMILION, align=0.5)

    def _draw_energy(self, canvas: Canvas, view: View) -> None:
        _card(canvas)
        width, height = canvas.size
        column = width / len(view.choices)
        for place, choice in enumerate(view.choices):
            size = (int(column), 210)
            _draw_choice(canvas.part((place * column, 0.0), size, 1.0), choice)
        amounts = view.moment.bars.values()
        draw_bars(canvas, 210.0, view.moment.bars, (min(0.0, *amounts), max(1.0, *amounts)))
        top = 218.0 + len(view.moment.bars) * BAR
        size = (int(width), int(height - top - 6.0))
        draw_course(canvas.part((0.0, top), size, 1.0), view.course, SHOWN)


def _card(canvas: Canvas) -> None:
    width, height = canvas.size
    canvas.box((width / 2, height / 2), (width, height), 12.0, WHITE)


def _draw_choice(canvas: Canvas, choice: Choice) -> None:
    canvas.text(choice.title, (_CARD_GAP, 22.0), 21, MUTED)
    for row, name in enumerate(choice.names):
        y = 48.0 + row * _LINE
        if row == choice.chosen:
            wide = canvas.size[0] - 2 * _CARD_GAP
            canvas.box((_CARD_GAP + wide / 2, y), (wide, _LINE - 2.0), 6.0, tint(BLUE, 0.16))
        canvas.text(name, (_CARD_GAP + 8.0, y), 22, INK if row == choice.chosen else MUTED)
