"""The window of a game, on SDL's display that shows nothing: keys in, pictures out."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pygame
import pytest

from integ_gym.cli import main
from integ_gym.envs.rendering.canvas import GREEN, INK, VERMILION
from integ_gym.eval import play as playing
from integ_gym.eval.play import Game


class Clock:
    """A clock that is set by hand."""

    now = 50.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def shown(monkeypatch) -> Iterator[tuple[Game, playing.Window, Clock]]:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    game, clock = Game("IntegPendulum-v0", {}, seed=0), Clock()
    window = playing.Window(game, clock)
    pygame.event.clear()
    yield game, window, clock
    window.close()


def press(key: int, mod: int = 0) -> None:
    pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=key, mod=mod))


def release(key: int) -> None:
    pygame.event.post(pygame.event.Event(pygame.KEYUP, key=key, mod=0))


def passes(shown, seconds: float) -> None:
    """Time, in pictures of a fiftieth of a second."""
    _, window, clock = shown
    for _ in range(round(seconds / 0.02)):
        clock.now += 0.02
        assert window.frame()


def test_time_passes_as_it_does(shown):
    game, *_ = shown
    passes(shown, 2.0)
    assert game.time == pytest.approx(2.0, abs=0.05)


def test_a_game_that_was_held_up_does_not_hurry(shown):
    game, window, clock = shown
    clock.now += 60.0
    window.frame()
    assert game.time <= 0.25


def test_arrows_push_while_they_are_held(shown):
    game, *_ = shown
    press(pygame.K_LEFT)
    passes(shown, 0.1)
    assert game.push == 1.0  # counter-clockwise
    press(pygame.K_RIGHT)
    passes(shown, 0.1)
    assert game.push == -1.0
    release(pygame.K_RIGHT)
    passes(shown, 0.1)
    assert game.push == 1.0
    release(pygame.K_LEFT)
    passes(shown, 0.1)
    assert game.push == 0.0
    assert game.ledger()["motor"] != 0.0


def test_left_pushes_a_cart_to_the_left(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    game = Game("IntegCartPoleSwingUp-v0", {}, seed=0)
    window = playing.Window(game)
    press(pygame.K_LEFT)
    window.frame()
    assert game.push == -1.0
    window.close()


def test_the_discretization_changes_while_it_moves(shown):
    game, *_ = shown
    passes(shown, 1.0)
    before = game.view().moment.state
    press(pygame.K_1)
    press(pygame.K_DOWN)
    shown[1].frame()
    np.testing.assert_array_equal(game.view().moment.state, before)
    assert game.setup.settings.integrator == game.integrators[0]
    assert game.setup.settings.dt == 0.025
    press(pygame.K_UP)
    press(pygame.K_TAB)
    press(pygame.K_TAB, pygame.KMOD_LSHIFT)
    press(pygame.K_TAB)
    passes(shown, 0.1)
    assert game.setup.settings.integrator == game.integrators[1]
    assert game.setup.settings.dt == 0.05


def test_a_pause_and_another_beginning(shown):
    game, *_ = shown
    passes(shown, 1.0)
    time = game.time
    press(pygame.K_SPACE)
    passes(shown, 1.0)
    assert game.time == time
    press(pygame.K_SPACE)
    press(pygame.K_r)
    passes(shown, 0.1)
    assert game.time < 0.2


def test_what_is_on_the_screen(shown):
    """The goal, the arrow of the torque and the ledger are in their colours."""
    press(pygame.K_RIGHT)
    passes(shown, 2.0)
    picture = pygame.surfarray.array3d(pygame.display.get_surface()).astype(int)
    for colour in (GREEN, INK, VERMILION):
        assert (np.abs(picture - colour).max(axis=2) <= 6).sum() > 100


@pytest.mark.parametrize("key", [pygame.K_ESCAPE, pygame.K_q, None])
def test_a_game_is_left(shown, key):
    if key is None:
        pygame.event.post(pygame.event.Event(pygame.QUIT))
    else:
        press(key)
    assert not shown[1].frame()


def test_the_command_says_what_came_of_it(monkeypatch, capsys):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pygame.display.init()
    press(pygame.K_RIGHT)
    monkeypatch.setattr(
        pygame.time, "wait", lambda _: pygame.event.post(pygame.event.Event(pygame.QUIT))
    )
    assert main(["play", "--env", "IntegCartPoleSwingUp-v0"]) == 0
    assert "numerics" in capsys.readouterr().out


def test_without_a_display_the_remedy_is_said(monkeypatch, capsys):
    def refuse(size):
        raise pygame.error("No available video device")

    monkeypatch.setattr(pygame.display, "set_mode", refuse)
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    assert main(["play"]) == 2
    error = capsys.readouterr().err
    assert "No available video device" in error
    assert error.count("\n") == 1
