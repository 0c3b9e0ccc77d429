"""Pictures of an episode: in a window, or as arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from time import perf_counter, sleep
from typing import Any, ClassVar
from weakref import WeakValueDictionary

import numpy as np
import numpy.typing as npt

from ..settings import Setup
from .canvas import INK, MUTED, WHITE, Canvas, load_pygame, open_screen
from .plants import find_drawing, format_signed

_MAX_FPS = 60
_LARGEST_LAG = 0.25
"""A window further behind than this goes on from where it is, s."""


class Renderer:
    """Draws the states of one environment.

    Args:
        setup: what is drawn.
        mode: ``"rgb_array"`` draws off-screen, ``"human"`` in a window, in real time;
            all windows of a process are parts of one, side by side.
        fps: how often :meth:`draw` is called per second of simulated time; a window shows
            at most 60 of these pictures per second.

    Raises:
        ModuleNotFoundError: without pygame, with the command that installs it.
    """

    def __init__(self, setup: Setup, mode: str, fps: int) -> None:
        self.setup = setup
        self._drawing = find_drawing(setup.plant.name)
        self._canvas = Canvas(self._drawing.size)
        self._pane = _Pane(self._drawing.size) if mode == "human" else None
        self._pace = _Pace(fps)

    def draw(
        self, state: npt.NDArray[np.float64], controls: Sequence[float], time: float
    ) -> npt.NDArray[np.uint8] | None:
        """Draw one state, shape (n,), the applied controls and the time in seconds.

        Returns:
            The picture, shape (height, width, 3), or None where it goes to a window.
        """
        if self._pane is None:
            self._draw(state, controls, time)
            return self._canvas.pixels()
        if self._pace.due(time):
            self._draw(state, controls, time)
            self._pace.wait(time)
            self._pane.show(self._canvas.frame())
            self._pace.shown(time)
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._pane is not None:
            self._pane.close()

    def _draw(self, state: npt.NDArray[np.float64], controls: Sequence[float], time: float) -> None:
        canvas, setup = self._canvas, self.setup
        canvas.clear()
        self._drawing.draw(canvas, setup, [float(x) for x in state], controls)
        width, height = canvas.size
        canvas.text(discretization_label(setup), (16.0, 22.0), 24, INK)
        digits = 2 if setup.timing.control_period >= 0.01 else 3
        canvas.text(f"t = {time:.{digits}f} s", (16.0, height - 22.0), 24, MUTED)
        label = ", ".join(control_labels(setup, controls))
        canvas.text(label, (width - 16.0, height - 22.0), 24, MUTED, align=1.0)


def discretization_label(setup: Setup) -> str:
    """Engine, integrator, step and, where it differs, control period."""
    settings, timing = setup.settings, setup.timing
    integrator = settings.integrator.rpartition(":")[2]
    parts = [settings.engine.rpartition(":")[2], integrator, f"dt {timing.dt:g} s"]
    if timing.substeps != 1:
        parts.append(f"control every {timing.control_period:g} s")
    return " · ".join(parts)


def control_labels(setup: Setup, controls: Sequence[float]) -> list[str]:
    """Name, value and unit of each control, with the digits that its limits ask for."""
    labels = []
    parts = zip(setup.plant.controls, controls, setup.largest_controls, strict=True)
    for (name, unit), value, most in parts:
        digits = max(2, 1 - math.floor(math.log10(most)))
        labels.append(f"{name.replace('_', ' ')} {format_signed(float(value), digits)} {unit}")
    return labels


class _Pace:
    """Decides which pictures to show, and when, so that simulated time passes like real time."""

    def __init__(self, fps: int) -> None:
        self._between = 1.0 / _MAX_FPS if fps > _MAX_FPS else 0.0
        self._last = math.inf
        self._began = 0.0

    def due(self, time: float) -> bool:
        """Whether to show the picture of a simulated time; one after a reset always is."""
        return time <= self._last or time - self._last >= self._between

    def wait(self, time: float) -> None:
        """Wait until a simulated time comes."""
        if time > self._last:
            sleep(max(0.0, self._began + time - perf_counter()))

    def shown(self, time: float) -> None:
        """Note what was shown just now; a new episode, or one far behind, is timed from here."""
        now = perf_counter()
        if time < self._last or now - self._began - time > _LARGEST_LAG:
            self._began = now - time
        self._last = time


class _Pane:
    """One renderer's part of the window.

    ``pygame.display`` has one window per process, so those who share it stand side by side. A
    pane that is no longer held leaves it.
    """

    shown: ClassVar[WeakValueDictionary[int, _Pane]] = WeakValueDictionary()

    def __init__(self, size: tuple[int, int]) -> None:
        self._pygame = load_pygame()
        self.size = size
        self.picture: Any = None

    def show(self, picture: Any) -> None:
        """Show a ``pygame.Surface``."""
        self.picture = picture
        self.shown[id(self)] = self
        self._refresh()

    def close(self) -> None:
        """Leave the window, and close it after the last one has left."""
        if self.shown.pop(id(self), None) is None:
            return
        if self.shown:
            self._refresh()
        else:
            self._pygame.display.quit()

    def _refresh(self) -> None:
        panes = list(self.shown.values())
        columns = math.ceil(math.sqrt(len(panes)))
        width, height = (max(pane.size[axis] for pane in panes) for axis in (0, 1))
        screen = self._screen((columns * width, math.ceil(len(panes) / columns) * height))
        screen.fill(WHITE)
        for index, pane in enumerate(panes):
            row, column = divmod(index, columns)
            screen.blit(pane.picture, (column * width, row * height))
        self._pygame.event.pump()
        self._pygame.display.flip()

    def _screen(self, size: tuple[int, int]) -> Any:
        """The window's surface; opens the window or gives it the size it needs."""
        screen = self._pygame.display.get_surface()
        if screen is None or screen.get_size() != size:
            return open_screen(size, "integ-gym")
        return screen
