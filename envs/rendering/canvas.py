"""A canvas for clean, anti-aliased pictures, and the colours to use on it: those of light pages."""

from __future__ import annotations

import copy
import io
import math
import os
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.support.errors import InputError
from integ_gym.support.figures import AMOUNTS, HUES, PALETTE, channels
from integ_gym.support.optional import load
from integ_gym.support.terminal import fixed

Colour = tuple[int, int, int]
Point = tuple[float, float]

PAGE, WHITE, INK, MUTED, FAINT, GREEN, FAILS = (
    channels(PALETTE[name][0])
    for name in ("page", "card", "ink", "soft", "line", "transfers", "fails")
)
BLUE, VERMILION = (channels(HUES[name][0]) for name in ("blue", "vermilion"))

_ARC_STEP = math.radians(1.5)


def tint(colour: Colour, strength: float) -> Colour:
    """``colour`` mixed into white; a strength of 1 is the colour itself, 0 is white."""
    red, green, blue = (round(255 + strength * (c - 255)) for c in colour)
    return red, green, blue


def polar(centre: Point, radius: float, angle: float) -> Point:
    """The point at ``angle`` (rad, counter-clockwise from straight up) on a circle."""
    return centre[0] - radius * math.sin(angle), centre[1] - radius * math.cos(angle)


def load_pygame() -> Any:
    """pygame, without the greeting that it prints on standard output.

    Raises:
        ModuleNotFoundError: if it is not installed, with the command that installs it.
    """
    with redirect_stdout(io.StringIO()):
        return load("pygame", "render")


class Canvas:
    """An off-screen picture; points are (x right, y down) in pixels of the finished frame.

    Angles are in radians, counter-clockwise from straight up. No display is needed.

    Args:
        size: (width, height) of the finished frame.
        oversize: everything is drawn this many times too large and averaged down, exactly for a
            power of two.
    """

    def __init__(self, size: tuple[int, int], oversize: int = 4) -> None:
        self.size = size
        self._scale = float(oversize)
        self._pygame = load_pygame()
        # The depth is given because without it the surface copies that of an open window.
        self._surface = self._pygame.Surface((size[0] * oversize, size[1] * oversize), depth=32)
        self._frame = self._pygame.Surface(size, depth=32)

    def clear(self, colour: Colour = WHITE) -> None:
        """Make everything one colour."""
        self._surface.fill(colour)

    def part(self, corner: Point, size: tuple[int, int], scale: float) -> Canvas:
        """A canvas within this one; what is drawn on it shows here, cut at its edges.

        Args:
            corner: its upper left corner here.
            size: (width, height) in its own pixels.
            scale: pixels here to one of its own.
        """
        part = copy.copy(self)
        part.size, part._scale = size, self._scale * scale
        area = [*(c * self._scale for c in corner), *(n * part._scale for n in size)]
        part._surface = self._surface.subsurface([round(x) for x in area])
        return part

    def frame(self) -> Any:
        """The finished ``pygame.Surface``, overwritten by the next call."""
        return self._pygame.transform.smoothscale(self._surface, self.size, self._frame)

    def pixels(self) -> npt.NDArray[np.uint8]:
        """The finished picture as an array of its own, shape (height, width, 3)."""
        content = self._pygame.image.tobytes(self.frame(), "RGB")
        return np.frombuffer(content, dtype=np.uint8).reshape(*self.size[::-1], 3).copy()

    def polygon(self, points: Sequence[Point], colour: Colour) -> None:
        """A filled polygon."""
        self._pygame.draw.polygon(self._surface, colour, [self._pixel(p) for p in points])

    def disc(self, centre: Point, radius: float, colour: Colour) -> None:
        """A filled circle."""
        x, y = self._inside(centre)
        where = round(x * self._scale), round(y * self._scale)
        self._pygame.draw.circle(self._surface, colour, where, round(radius * self._scale))

    def line(
        self, start: Point, end: Point, width: float, colour: Colour, *, rounded: bool = True
    ) -> None:
        """A thick line."""
        along = math.hypot(end[0] - start[0], end[1] - start[1])
        if along:
            across_x = (end[1] - start[1]) / along * width / 2
            across_y = (start[0] - end[0]) / along * width / 2
            sides = [(p, s) for p, s in ((start, 1), (end, 1), (end, -1), (start, -1))]
            corners = [(p[0] + s * across_x, p[1] + s * across_y) for p, s in sides]
            self.polygon(corners, colour)
        if rounded:
            self.disc(start, width / 2, colour)
            self.disc(end, width / 2, colour)

    def box(self, centre: Point, size: Point, radius: float, colour: Colour) -> None:
        """A filled rectangle with rounded corners."""
        x, y = self._pixel((centre[0] - size[0] / 2, centre[1] - size[1] / 2))
        area = (x, y, round(size[0] * self._scale), round(size[1] * self._scale))
        corner = round(radius * self._scale)
        self._pygame.draw.rect(self._surface, colour, area, border_radius=corner)

    def arc(
        self,
        centre: Point,
        radii: tuple[float, float],
        angles: tuple[float, float],
        colour: Colour,
        *,
        taper: bool = False,
    ) -> None:
        """The part of a ring between two radii and two angles; it may taper to its first angle."""
        start, end = angles
        middle, half = sum(radii) / 2, (radii[1] - radii[0]) / 2
        count = max(2, math.ceil(abs(end - start) / _ARC_STEP) + 1)
        inner, outer = [], []
        for i in range(count):
            share = i / (count - 1)
            reach = half * share if taper else half
            angle = start + share * (end - start)
            inner.append(polar(centre, middle - reach, angle))
            outer.append(polar(centre, middle + reach, angle))
        self.polygon(inner + outer[::-1], colour)

    def arc_arrow(
        self,
        centre: Point,
        radius: float,
        angles: tuple[float, float],
        width: float,
        colour: Colour,
    ) -> None:
        """An arrow along a circle from the first angle to its tip; a short one has a small head."""
        start, tip = angles
        full = 3.4 * width / radius
        head = min(full, abs(tip - start))
        neck = tip - math.copysign(head, tip - start)
        self.arc(centre, (radius - width / 2, radius + width / 2), (start, neck), colour)
        half = 1.2 * width * head / full
        self.arc(centre, (radius - half, radius + half), (tip, neck), colour, taper=True)

    def arrow(self, start: Point, tip_x: float, width: float, colour: Colour) -> None:
        """A straight horizontal arrow; a short one has a small head."""
        (x, y), full = start, 2.6 * width
        head = min(full, abs(tip_x - x))
        neck = tip_x - math.copysign(head, tip_x - x)
        self.line(start, (neck, y), width, colour, rounded=False)
        half = 1.3 * width * head / full
        self.polygon([(neck, y - half), (neck, y + half), (tip_x, y)], colour)

    def text(
        self, text: str, where: Point, size: float, colour: Colour, *, align: float = 0.0
    ) -> None:
        """One line of text whose left end (``align`` 0), middle (0.5) or right end (1) is given.

        It is made smaller where it would be wider than the picture.
        """
        image = _render_text(text, round(size * self._scale), colour)
        widest = self._surface.get_width() - 2 * 16 * self._scale
        if image.get_width() > widest:
            smaller = size * widest / image.get_width()
            image = _render_text(text, round(smaller * self._scale), colour)
        x = where[0] * self._scale - align * image.get_width()
        y = where[1] * self._scale - image.get_height() / 2
        self._surface.blit(image, (round(x), round(y)))

    def _inside(self, point: Point) -> Point:
        """A point far outside the picture brought near enough for whole numbers."""
        (x, y), (width, height) = point, self.size
        return (
            max(-3.0 * width, min(4.0 * width, x)),
            max(-3.0 * height, min(4.0 * height, y)),
        )

    def _pixel(self, point: Point) -> tuple[int, int]:
        x, y = self._inside(point)
        return round(x * self._scale - 0.5), round(y * self._scale - 0.5)


@lru_cache(1024)
def _render_text(text: str, size: int, colour: Colour) -> Any:
    """A line of text as a picture, in pygame's own font, which is the same everywhere.

    Pictures are kept and the font is not: ``pygame.quit()`` breaks fonts.
    """
    pygame = load_pygame()
    pygame.font.init()
    return pygame.font.Font(None, size).render(text, True, colour)


BAR = 24
"""Height of a bar with the room around it, pixels."""
_NAME, _VALUE, _EDGE = 74.0, 68.0, 14.0


def draw_bars(
    canvas: Canvas, top: float, amounts: Mapping[str, float], reach: tuple[float, float]
) -> None:
    """Draw amounts below one another, over the whole width.

    Args:
        canvas: what is drawn on.
        top: of the first bar.
        amounts: name to value, J; NaN where it is not known.
        reach: value at the left and at the right end, J, the first not above 0.
    """
    for row, (name, value) in enumerate(amounts.items()):
        _bar(canvas, top + (row + 0.5) * BAR, name, value, reach)


def colour_of(amount: str, value: float = 0.0) -> Colour:
    """Colour of an amount of energy, by its name."""
    above, below = AMOUNTS[amount]
    return channels(PALETTE[above if value >= 0.0 else below][0])


def _bar(canvas: Canvas, y: float, name: str, value: float, reach: tuple[float, float]) -> None:
    (low, high), end = reach, canvas.size[0] - _EDGE
    left, right = _EDGE + _NAME, end - _VALUE
    scale = (right - left) / (high - low)
    zero = left - scale * low
    canvas.text(name, (_EDGE, y), 20, MUTED)
    canvas.box(((left + right) / 2, y), (right - left, 12.0), 3.0, tint(FAINT, 0.7))
    known = math.isfinite(value)
    if known:
        tip = zero + scale * max(low, min(high, value))
        canvas.box(((zero + tip) / 2, y), (abs(tip - zero), 12.0), 0.0, colour_of(name, value))
    canvas.line((zero, y - 8.0), (zero, y + 8.0), 1.5, INK, rounded=False)
    said = f"{fixed(value, 1, name == 'numerics')} J" if known else "not known"
    canvas.text(said, (end, y), 20, INK if known else MUTED, align=1.0)


_UNSEEN = ("dummy", "offscreen")
"""Drivers of SDL that show nothing; it takes one where there is no screen."""


def open_screen(size: tuple[int, int], caption: str) -> Any:
    """Open the window, or give it another size.

    Args:
        size: (width, height), pixels.
        caption: what stands above it.

    Returns:
        Its surface.

    Raises:
        ValueError: where there is no screen, but for a driver that ``SDL_VIDEODRIVER`` names.
    """
    pygame = load_pygame()
    display = pygame.display
    try:
        display.init()
        if display.get_driver() in _UNSEEN and "SDL_VIDEODRIVER" not in os.environ:
            display.quit()
            raise pygame.error("there is no screen")
        surface = display.set_mode(size)
    except pygame.error as error:
        raise InputError(f"no window can be opened ({error})") from None
    display.set_caption(caption)
    return surface
