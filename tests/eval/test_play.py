"""Playing: what a change keeps, where the energy comes from, keys in and pictures out."""

from collections.abc import Iterator

import numpy as np
import pygame
import pytest

from integ_gym.cli import main
from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.eval.play import Game, Window, list_keys

PENDULUM = "IntegPendulum-v0"
IDS = tuple(ENVIRONMENTS)


def advance(game: Game, seconds: float) -> None:
    end = game.time + seconds
    while game.time < end - 1e-9 and not game.ended:
        game.advance()


@pytest.mark.parametrize("env_id", IDS)
def test_the_ledger_holds_over_every_change(env_id):
    game = Game(env_id, {}, seed=3)
    first = float(game.view().course.amounts["energy"][0])
    for place in range(len(game.integrators)):
        game.choose_integrator(place)
        game.refine((-1) ** place)
        game.push = (-1.0) ** place
        advance(game, 4 * game.period)
    parts = game.ledger()
    energy = parts.pop("energy")
    assert first + sum(parts.values()) == pytest.approx(energy, abs=1e-9)
    assert game.time > 0.0


def test_numerics_give_on_explicit_euler_take_on_implicit_and_do_nothing_on_the_truth():
    numerics = {}
    for integrator in ("explicit_euler", "implicit_euler", "reference"):
        game = Game(PENDULUM, {"integrator": integrator}, seed=1)
        game.push = 1.0
        advance(game, 3.0)
        numerics[integrator] = game.ledger()["numerics"]
    assert numerics["explicit_euler"] > 0.1
    assert numerics["implicit_euler"] < -0.1
    assert abs(numerics["reference"]) < 1e-9


def test_steps_and_integrators_are_those_that_there_are():
    game = Game(PENDULUM, {}, seed=0)
    game.refine(-20)
    assert game.setup.settings.dt == game.period == 0.2
    game.refine(20)
    assert game.setup.settings.dt == 0.00625
    assert game.period == 0.025
    game.choose_integrator(0)
    game.turn_integrator(-1)
    game.choose_integrator(99)
    assert game.setup.settings.integrator == "reference" == game.integrators[-1]
    late = Game(PENDULUM, {"action_latency": 0.05}, seed=0)
    assert late.steps == (0.05, 0.025, 0.0125, 0.00625)


def test_an_integrator_of_ones_own_is_one_of_the_choices():
    game = Game(PENDULUM, {"integrator": "planted:Heun"}, seed=0)
    assert game.integrators[0] == "planted:Heun"
    assert game.view().choices[0].names[0] == "1  Heun"


def test_a_lost_game_stays_as_it_is_and_begins_again():
    game = Game("IntegCartPole-v0", {}, seed=0)
    game.advance()
    assert game.view().moment.controls == (0.0,)  # a hand that rests
    game.push = -1.0
    game.advance()
    assert game.view().moment.controls == (-10.0,)
    advance(game, 5.0)
    assert game.ended == "the task is lost"
    assert "R begins again" in game.view().warning
    time = game.time
    game.advance()
    assert game.time == time
    game.restart()
    assert (game.time, game.ended, game.push) == (0.0, "", 0.0)
    assert sum(game.ledger().values()) == pytest.approx(game.ledger()["energy"])


def test_numbers_that_blow_up_are_said_to():
    game = Game("IntegElasticPendulum-v0", {"integrator": "explicit_euler", "dt": 0.1}, seed=0)
    advance(game, 60.0)
    assert game.ended == "the numbers blew up"
    assert np.isfinite(game.view().moment.state).all()


@pytest.mark.parametrize(("env_id", "named"), [(PENDULUM, False), ("IntegQuadrotor-v0", True)])
def test_keys_are_named_where_they_do_something(env_id, named):
    controls = []
    for lift in (0.0, 1.0):
        game = Game(env_id, {}, seed=0)
        game.lift = lift
        game.advance()
        controls.append(game.view().moment.controls)
    assert ("W, S" in list_keys(game.setup.plant)) == (controls[0] != controls[1]) == named


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--env", "Nowhere-v0"], "unknown environment 'Nowhere-v0'"),
        (["--integrator", "rk5"], "unknown integrator 'rk5'"),
        (["--env-arg", "control_period=0.1"], "follows the step during play"),
        (["--env-arg", 'mixture=[{"dt": 0.05}]'], "nothing is drawn from a `mixture`"),
    ],
)
def test_bad_input_ends_with_one_line(words, message, capsys):
    assert main(["play", *words]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


class Screen:
    """A game on SDL's display that shows nothing, and a clock that is set by hand."""

    def __init__(self, env_id: str = PENDULUM) -> None:
        self.game, self.now = Game(env_id, {}, seed=0), 50.0
        self.window = Window(self.game, lambda: self.now)
        pygame.event.clear()

    def frames(self, seconds: float) -> None:
        """Time, in pictures of a fiftieth of a second."""
        for _ in range(round(seconds / 0.02)):
            self.now += 0.02
            assert self.window.frame()


def press(*keys: int, mod: int = 0, kind: int = pygame.KEYDOWN) -> None:
    for key in keys:
        pygame.event.post(pygame.event.Event(kind, key=key, mod=mod))


@pytest.fixture
def screen(monkeypatch) -> Iterator[Screen]:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    screen = Screen()
    yield screen
    screen.window.close()


def test_time_passes_as_it_does_and_is_not_caught_up_with(screen):
    screen.frames(2.0)
    time = screen.game.time
    assert time == pytest.approx(2.0, abs=0.05)
    screen.now += 60.0
    screen.window.frame()
    assert screen.game.time <= time + 0.3
    press(pygame.K_SPACE)
    screen.frames(0.1)
    time = screen.game.time
    screen.frames(1.0)
    assert screen.game.time == time
    press(pygame.K_SPACE, pygame.K_r)
    screen.frames(0.1)
    assert screen.game.time < 0.2


def test_arrows_push_while_they_are_held(screen):
    for key, kind, push in (
        (pygame.K_LEFT, pygame.KEYDOWN, 1.0),  # counter-clockwise
        (pygame.K_RIGHT, pygame.KEYDOWN, -1.0),
        (pygame.K_RIGHT, pygame.KEYUP, 1.0),
        (pygame.K_LEFT, pygame.KEYUP, 0.0),
    ):
        press(key, kind=kind)
        screen.frames(0.1)
        assert screen.game.push == push
    assert screen.game.ledger()["motor"] != 0.0
    cart = Screen("IntegCartPoleSwingUp-v0")
    press(pygame.K_LEFT)
    cart.window.frame()
    assert cart.game.push == -1.0


def test_the_discretization_changes_while_it_moves(screen):
    game = screen.game
    screen.frames(1.0)
    before = game.view().moment.state
    press(pygame.K_1, pygame.K_DOWN)
    screen.window.frame()
    np.testing.assert_array_equal(game.view().moment.state, before)
    assert game.setup.settings.integrator == game.integrators[0]
    assert game.setup.settings.dt == 0.025
    press(pygame.K_UP, pygame.K_TAB)
    press(pygame.K_TAB, mod=pygame.KMOD_LSHIFT)
    press(pygame.K_TAB)
    screen.frames(0.1)
    assert game.setup.settings.integrator == game.integrators[1]
    assert game.setup.settings.dt == 0.05


def test_two_hands_fly_a_quadrotor(monkeypatch):
    """One tilts, the other lifts; at rest both rotors are at the middle of their limits."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    screen = Screen("IntegQuadrotor-v0")
    screen.frames(0.04)
    assert screen.game.view().moment.controls == (3.0, 3.0)
    press(pygame.K_RIGHT, pygame.K_w)
    screen.frames(0.04)
    assert screen.game.view().moment.controls == pytest.approx((3.96, 3.84))
    press(pygame.K_RIGHT, pygame.K_w, kind=pygame.KEYUP)
    press(pygame.K_s)
    screen.frames(0.04)
    assert screen.game.view().moment.controls == pytest.approx((2.1, 2.1))
    screen.window.close()


def test_two_hands_drive_a_hopper(monkeypatch):
    """One turns the hip, the other stretches the leg; it lands, and there is no goal at rest."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    screen = Screen("IntegHopper-v0")
    screen.frames(0.04)
    assert screen.game.view().moment.controls == (0.0, 0.0)
    press(pygame.K_LEFT, pygame.K_w)
    screen.frames(0.04)
    assert screen.game.view().moment.controls == (-20.0, 150.0)
    press(pygame.K_LEFT, pygame.K_w, kind=pygame.KEYUP)
    press(pygame.K_s)
    screen.frames(0.04)
    assert screen.game.view().moment.controls == (0.0, -150.0)
    press(pygame.K_s, kind=pygame.KEYUP)
    screen.frames(2.0)
    view = screen.game.view()
    assert screen.game.ended == "the task is lost"
    assert screen.game.ledger()["losses"] < 0.0
    assert view.course.goal is None
    screen.window.close()


def test_the_command_says_what_came_of_it(monkeypatch, capsys):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pygame.display.init()
    press(pygame.K_RIGHT)
    monkeypatch.setattr(pygame.time, "wait", lambda _: press(0, kind=pygame.QUIT))
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
