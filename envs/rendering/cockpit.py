"""The screen of somebody who drives a plant: the plant, the choices there are, and its energy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..episode.settings import Setup
from .bars import BAR, draw_bars
from .canvas import BLUE, INK, MUTED, PAGE, VERMILION, WHITE, Canvas, tint
from .course import Course, draw_course
from .panes import Moment
from .plants import drawing

_SIZE = (1000, 640)
_GAP, _TOP, _CARD = 14.0, 60.0, 500.0
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
        self._drawing = drawing(setup.plant.name)
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
        canvas.clear()
        width, height = canvas.size
        canvas.box((width / 2, height / 2), (width, height), 0.0, PAGE)
        canvas.text(view.title, (_GAP + 4, 32.0), 34, INK)
        canvas.text(f"{view.time:.1f} s", (width - _GAP - 4, 32.0), 34, INK, align=1.0)
        self._draw_plant(canvas.part((_GAP, _TOP), (int(_LEFT), int(_CARD)), 1.0), view)
        right = int(width - _LEFT - 3 * _GAP)
        self._draw_energy(canvas.part((_LEFT + 2 * _GAP, _TOP), (right, int(_CARD)), 1.0), view)
        for row, line in enumerate(self._help):
            canvas.text(line, (_GAP + 4, _TOP + _CARD + 28.0 + row * 26.0), 21, MUTED)

    def _draw_plant(self, canvas: Canvas, view: View) -> None:
        _card(canvas)
        width, height = canvas.size
        shrink = (width - 2 * _GAP) / self._drawing.size[0]
        top = (height - shrink * self._drawing.size[1]) / 2
        picture = canvas.part((_GAP, top), self._drawing.size, shrink)
        state = [float(x) for x in view.moment.state]
        self._drawing.draw(picture, self._setup, state, view.moment.control)
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
    canvas.text(choice.title, (_GAP, 22.0), 21, MUTED)
    for row, name in enumerate(choice.names):
        y = 48.0 + row * _LINE
        if row == choice.chosen:
            wide = canvas.size[0] - 2 * _GAP
            canvas.box((_GAP + wide / 2, y), (wide, _LINE - 2.0), 6.0, tint(BLUE, 0.16))
        canvas.text(name, (_GAP + 8.0, y), 22, INK if row == choice.chosen else MUTED)
