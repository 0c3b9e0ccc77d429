"""Amounts of energy over time, as lines."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from integ_gym.support.terminal.formatting import fixed

from .bars import colour_of
from .canvas import BLUE, FAINT, GREEN, INK, MUTED, Canvas, Point

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
