"""Doubts about a task: a rule of success that is upside down, and rewards of an unknown kind."""

from __future__ import annotations

import pytest
from mountain_car import swing

import integ_gym
from integ_gym.cli import main

STATED = "integrator=symplectic_euler,dt=1,control_period=1"


def _evaluated(kind, out, dts=(1.0, 0.5), limit=None, **environment):
    return integ_gym.evaluate(
        swing, f"mountain_car:{kind}", out, dts=dts, episodes=2, home=STATED, workers=1,
        environment=environment, limit=limit,
    )  # fmt: skip


@pytest.fixture(scope="module")
def upside_down(tmp_path_factory):
    """Nothing says that the task ends at its goal, so surviving is the success."""
    out = tmp_path_factory.mktemp("upside")
    return _evaluated("SilentMountainCar", out), out


def test_a_rule_of_success_that_is_upside_down_is_said_first(upside_down):
    panel, out = upside_down
    first = (
        "The rule of success looks wrong: on gymnasium symplectic_euler dt=1, random succeeds "
        "in 100 % of episodes with a mean return of −6.9, and swing succeeds in 0 % of episodes "
        "with a mean return of 8"
    )
    assert panel.answer.startswith(first)
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "The rule of success looks wrong: on" in page


def test_rewards_that_differ_in_kind_cast_doubt_where_nothing_is_said(upside_down):
    panel, out = upside_down
    (told,) = [doubt for doubt in panel.warnings if "SilentMountainCar" in doubt]
    assert "the reward of the decision that ends an episode (99.9) is of another kind" in told
    assert "those before it (-0.1)" in told
    assert 'give `held` rewards="rate", "sum" or "last"' in told
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "is of another kind than those before it" in page


def test_amounts_that_are_taken_for_rates_cast_doubt(tmp_path, capsys):
    command = ["evaluate", "--policy", "mountain_car:swing", "--env"]
    command += ["mountain_car:SilentScaledMountainCar", "--dt", "1", "--dt", "0.5"]
    command += ["--episodes", "2", "--success-return", "90", "--home", STATED, "--workers", "1"]
    assert main([*command, "--out", str(tmp_path / "out"), "--no-progress"]) == 0
    told = " ".join(capsys.readouterr().err.split())
    assert "rewards shrink with `dt` as amounts do that are scaled by it: a decision of" in told
    assert "SilentScaledMountainCar does not say what its rewards are" in told


@pytest.mark.parametrize("kind", ["MountainCar", "ScaledMountainCar"])
def test_of_rewards_that_are_said_there_is_no_doubt(kind, tmp_path):
    panel = _evaluated(kind, tmp_path, success_return=80.0)
    assert panel.warnings == ()
    assert "looks wrong" not in panel.answer


def test_of_one_step_per_decision_there_is_no_doubt(tmp_path):
    panel = _evaluated("SilentMountainCar", tmp_path, [1.0], success_return=80.0, limit=False)
    assert panel.warnings == ()


def test_doubts_follow_from_the_records(upside_down, capsys):
    """So that verifying the run finds nothing to object to."""
    _, out = upside_down
    assert main(["evidence", "verify", str(out), "--no-progress"]) == 0, capsys.readouterr()
