"""Playing: what a change of discretization keeps, and where the energy comes from."""

from __future__ import annotations

import math

import numpy as np
import pytest

from integ_gym.cli import main
from integ_gym.eval.play import Game

IDS = ("IntegPendulum-v0", "IntegCartPole-v0", "IntegCartPoleSwingUp-v0", "IntegElasticPendulum-v0")


def played(game: Game, seconds: float) -> None:
    end = game.time + seconds
    while game.time < end - 1e-9 and not game.ended:
        game.advance()


def start_energy(game: Game) -> float:
    return float(game.view().course.amounts["energy"][0])


@pytest.mark.parametrize("env_id", IDS)
def test_the_ledger_holds_over_every_change(env_id):
    game = Game(env_id, {}, seed=3)
    first = start_energy(game)
    for place in range(len(game.integrators)):
        game.choose_integrator(place)
        game.refine((-1) ** place)
        game.push = (-1.0) ** place
        played(game, 4 * game.period)
    parts = game.ledger()
    energy = parts.pop("energy")
    assert first + sum(parts.values()) == pytest.approx(energy, abs=1e-9)
    assert game.time > 0.0


def test_a_change_keeps_the_motion():
    game = Game("IntegPendulum-v0", {}, seed=0)
    game.push = 1.0
    played(game, 1.0)
    before = game.view().moment.state
    game.turn_integrator(1)
    game.refine(1)
    np.testing.assert_array_equal(game.view().moment.state, before)
    assert game.setup.settings.dt == game.steps[3] == 0.025


def test_numerics_give_on_explicit_euler_take_on_implicit_and_do_nothing_on_the_truth():
    given = {}
    for integrator in ("explicit_euler", "implicit_euler", "reference"):
        game = Game("IntegPendulum-v0", {"integrator": integrator}, seed=1)
        game.push = 1.0
        played(game, 3.0)
        given[integrator] = game.ledger()["numerics"]
    assert given["explicit_euler"] > 0.1
    assert given["implicit_euler"] < -0.1
    assert abs(given["reference"]) < 1e-9


def test_steps_are_as_coarse_and_fine_as_there_are():
    game = Game("IntegPendulum-v0", {}, seed=0)
    game.refine(-20)
    assert game.setup.settings.dt == game.period == 0.2
    game.refine(20)
    assert game.setup.settings.dt == 0.00625
    assert game.period == 0.025


def test_steps_that_do_not_go_with_the_arguments_are_left_out():
    game = Game("IntegPendulum-v0", {"action_latency": 0.05}, seed=0)
    assert game.steps == (0.05, 0.025, 0.0125, 0.00625)


def test_integrators_are_chosen_by_place_and_round():
    game = Game("IntegPendulum-v0", {}, seed=0)
    game.choose_integrator(0)
    game.turn_integrator(-1)
    assert game.setup.settings.integrator == "reference" == game.integrators[-1]
    game.choose_integrator(99)
    assert game.setup.settings.integrator == "reference"


def test_an_integrator_of_ones_own_is_one_of_the_choices(tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text(
        "from integ_gym.envs.integrators.rk4 import RK4\n\n\nclass Own(RK4):\n    pass\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    game = Game("IntegPendulum-v0", {"integrator": "mine:Own"}, seed=0)
    assert game.integrators[0] == "mine:Own"
    assert game.view().choices[0].names[0] == "1  Own"


def test_a_resting_hand_does_not_push_a_cart_that_can_only_be_pushed():
    game = Game("IntegCartPole-v0", {}, seed=0)
    game.advance()
    assert game.view().moment.control == 0.0
    game.push = -1.0
    game.advance()
    assert game.view().moment.control == -10.0


def test_a_lost_game_stays_as_it_is_and_begins_again():
    game = Game("IntegCartPole-v0", {}, seed=0)
    game.push = 1.0
    played(game, 5.0)
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
    played(game, 60.0)
    assert game.ended == "the numbers blew up"
    assert np.isfinite(game.view().moment.state).all()


def test_what_is_shown_is_the_last_twenty_seconds():
    game = Game("IntegPendulum-v0", {}, seed=0)
    played(game, 30.0)
    course = game.view().course
    assert math.isclose(course.times[0], 10.0, abs_tol=0.06)
    assert course.goal == 10.0
    assert {len(amounts) for amounts in course.amounts.values()} == {len(course.times)}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--env", "Nowhere-v0"], "unknown environment 'Nowhere-v0'"),
        (["--integrator", "rk5"], "unknown integrator 'rk5'"),
        (["--env-arg", "control_period=0.1"], "follows the step while somebody plays"),
    ],
)
def test_bad_input_ends_with_one_line(words, message, capsys):
    assert main(["play", *words]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
