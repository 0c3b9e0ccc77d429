"""The window in which somebody plays: keys in, pictures out, in real time."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import Any

from integ_gym.envs.rendering.canvas import load_pygame, open_screen
from integ_gym.envs.rendering.cockpit import Cockpit

from .game import Game

HELP = (
    "Left, Right: push      Up, Down: coarser, finer step      1 to 9, Tab: integrator      "
    "Space: pause      R: again      Esc: leave",
    "motor: what you gave.  numerics: what the integrator's error gave (above 0) or took.  "
    "energy: the sum, with what there was at the start.",
)
_FRAMES = 60
_LARGEST_LAG = 0.25
"""A game further behind than this goes on from where it is, s."""


def play_in_window(game: Game) -> None:
    """Let somebody play until the window is closed, or Escape or Q is pressed.

    Raises:
        ValueError: where there is no display, with the remedy.
    """
    pygame = load_pygame()
    window = Window(game)
    try:
        while window.frame():
            pygame.time.wait(1000 // _FRAMES)
    finally:
        window.close()


class Window:
    """One game on the screen.

    Args:
        game: what is played.
        clock: time in s, from anywhere.

    Raises:
        ValueError: where there is no display, with the remedy.
    """

    def __init__(self, game: Game, clock: Callable[[], float] = perf_counter) -> None:
        self._pygame = load_pygame()
        self._game, self._clock = game, clock
        self._cockpit = Cockpit(game.setup, HELP)
        self._held: list[int] = []
        self._paused = False
        self._last = clock()
        self._due = 0.0
        self._keys = self._bindings()
        picture = self._cockpit.frame(game.view())
        try:
            self._screen = open_screen(picture.get_size(), "integ-gym play")
        except ValueError as error:
            raise ValueError(f"{error}; play on a machine with a display") from None

    def frame(self) -> bool:
        """Heed keys, let the time pass that has passed, draw; whether the game goes on."""
        for event in self._pygame.event.get():
            if not self._heeds(event):
                return False
        now = self._clock()
        self._due = min(_LARGEST_LAG, self._due + now - self._last)
        self._last = now
        if self._paused:
            self._due = 0.0
        while self._due >= self._game.period - 1e-9:
            self._due -= self._game.period
            self._game.advance()
        self._screen.blit(self._cockpit.frame(self._game.view()), (0, 0))
        self._pygame.display.flip()
        return True

    def close(self) -> None:
        """Close the window."""
        self._pygame.display.quit()

    def _heeds(self, event: Any) -> bool:
        """Do what an event asks for; whether the game goes on after it."""
        pygame = self._pygame
        if event.type == pygame.QUIT:
            return False
        if event.type == pygame.KEYUP and event.key in self._held:
            self._held.remove(event.key)
        if event.type == pygame.KEYDOWN:
            if event.key in (pygame.K_ESCAPE, pygame.K_q):
                return False
            if event.key in (pygame.K_LEFT, pygame.K_RIGHT) and event.key not in self._held:
                self._held.append(event.key)
            self._press(event.key, bool(getattr(event, "mod", 0) & pygame.KMOD_SHIFT))
        self._game.push = self._push()
        return True

    def _press(self, key: int, shifted: bool) -> None:
        if key == self._pygame.K_TAB:
            self._game.turn_integrator(-1 if shifted else 1)
        elif key in self._keys:
            self._keys[key]()

    def _bindings(self) -> dict[int, Callable[[], None]]:
        """Keys to what each does once when it goes down."""
        pygame, game = self._pygame, self._game
        numbers = {
            getattr(pygame, f"K_{n}"): lambda place=n - 1: game.choose_integrator(place)
            for n in range(1, 10)
        }
        return {
            **numbers,
            pygame.K_UP: lambda: game.refine(-1),
            pygame.K_DOWN: lambda: game.refine(1),
            pygame.K_r: game.restart,
            pygame.K_SPACE: self._pause,
        }

    def _pause(self) -> None:
        self._paused = not self._paused

    def _push(self) -> float:
        """Of the arrow that went down last: left is counter-clockwise, of a cart to the left."""
        if not self._held:
            return 0.0
        left = self._held[-1] == self._pygame.K_LEFT
        turns = self._game.setup.plant.control_name == "torque"
        return 1.0 if left == turns else -1.0
