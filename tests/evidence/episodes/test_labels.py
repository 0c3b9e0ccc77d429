"""Failure labels: every rule, and that the first one that fits is taken."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from integ_gym.evidence.fields import CELL_STATUSES, LABELS, SUMMARY_FIELDS
from integ_gym.evidence.labels import EpisodeFacts, Replays, failure_label

FAILED = EpisodeFacts(
    success=False,
    goal="|theta| < 0.2 rad",
    discretization="rk4 (native) at dt 0.05 s and control period 0.05 s",
    time=10.0,
    episode_return=-1000.0,
    solver_status="ok",
    saturated_share=0.1,
    goal_reached=None,
    goal_left=None,
    goal_since=None,
)
HOME = Replays(home="is home")
EVERYTHING = Replays(
    home=False,
    without_noise=False,
    without_delay=False,
    second_horizon=False,
    home_success=1.0,
    cell_status="achievable",
)
NEVER = (
    "it never reached the goal (|theta| < 0.2 rad) in 10 s, with 10 % of the control steps "
    "saturated."
)


def _label(replays=HOME, **changes):
    return failure_label(replace(FAILED, **changes), replays)


def test_success_needs_no_replay():
    label, reason = _label(Replays(), success=True, goal_since=3.25)
    assert label == "none"
    assert "3.25 s" in reason


@pytest.mark.parametrize("success", [True, False])
def test_broken_simulator_or_metric(success):
    label, reason = _label(success=success, solver_status="diverged", time=1.25)
    assert label == "evaluation_error"
    assert "1.25 s" in reason
    assert _label(success=success, episode_return=None)[0] == "evaluation_error"


def test_solver_that_did_not_converge_is_not_by_itself_an_evaluation_error():
    assert _label(solver_status="not_converged")[0] == "planning_error"


def test_unachievable():
    label, reason = _label(replace(HOME, cell_status="unachievable"))
    assert label == "unachievable"
    assert reason == (
        "a search over controls misses the goal's energy here from most starts, in twice the "
        f"time too; {NEVER}"
    )
    for status in (None, "achievable", "too_slow", "undecided"):
        assert _label(replace(HOME, cell_status=status)) == _label()
    assert _label(Replays(cell_status="unachievable"))[0] == "unachievable", "without any replay"
    success = {"success": True, "goal_since": 3.0}
    assert _label(Replays(cell_status="unachievable"), **success) == _label(HOME, **success)


def test_not_learned():
    label, reason = _label(replace(HOME, home_success=0.375))
    assert label == "not_learned"
    assert reason == f"the policy succeeds from 37.5 % of its starts at home; {NEVER}"
    assert "from 0 % of its starts" in _label(replace(HOME, home_success=0.0))[1]
    assert _label(replace(HOME, home_success=np.nextafter(0.5, 0.0)))[0] == "not_learned"
    for home in (None, 0.5, 1.0):
        assert _label(replace(HOME, home_success=home)) == _label()
    assert _label(Replays(home=True, home_success=0.25))[0] == "not_learned"
    assert _label(Replays(home_success=0.25))[0] == "not_learned", "without any replay"


def test_too_slow():
    label, reason = _label(replace(HOME, second_horizon=True))
    assert label == "too_slow"
    assert reason == (f"the same policy succeeds from the same start in twice the time; {NEVER}")
    for again in (None, False):
        assert _label(replace(HOME, second_horizon=again)) == _label()
    assert _label(Replays(home=True, second_horizon=True))[0] == "too_slow"
    assert _label(Replays(second_horizon=True))[0] == "too_slow", "without any other replay"
    assert _label(replace(HOME, cell_status="too_slow"))[0] == "planning_error"


def test_discretization():
    label, reason = _label(Replays(home=True))
    assert label == "discretization_error"
    assert "dt 0.05 s" in reason
    assert "on its training discretization," in reason
    assert "on a training discretization of it," in _label(Replays(home=True), homes=3)[1]
    assert _label(Replays(home=None))[0] == "unattributed"
    for home in (False, "is home", "no home"):
        assert _label(Replays(home=home))[0] == "planning_error"


def test_perception():
    noisy = {"observation_noise": 0.02}
    assert _label(replace(HOME, without_noise=True)) == _label()
    label, reason = _label(replace(HOME, without_noise=True), **noisy)
    assert label == "perception_error"
    assert "0.02" in reason
    assert _label(HOME, **noisy)[0] == "unattributed"
    assert _label(replace(HOME, without_noise=False), **noisy)[0] == "planning_error"


def test_state():
    stale = {"staleness": 0.15}
    assert _label(replace(HOME, without_delay=True)) == _label()
    label, reason = _label(replace(HOME, without_delay=True), **stale)
    assert label == "state_error"
    assert "0.15 s" in reason
    assert _label(HOME, **stale)[0] == "unattributed"
    assert _label(replace(HOME, without_delay=False), **stale)[0] == "planning_error"


def test_control():
    label, reason = _label(saturated_share=0.5)
    assert label == "control_error"
    assert "50 %" in reason
    assert _label(saturated_share=0.499)[0] == "planning_error"
    label, reason = _label(goal_reached=2.0, goal_left=4.5)
    assert label == "control_error"
    assert "2 s" in reason
    assert "4.5 s" in reason


def test_a_fall_is_told_as_the_end_that_it_was():
    """Where the goal is not to fall, it is held from the start and lost with the episode's end."""
    fall = {"time": 1.104, "goal": "not terminated within the time limit", "goal_reached": 0.0}
    label, reason = _label(**fall, goal_left=1.104, terminated=True)
    assert label == "control_error"
    assert reason == (
        "it was terminated at 1.104 s (asked: not terminated within the time limit), with 10 % of "
        "the control steps saturated."
    )
    label, reason = _label(Replays(home=True), **fall, goal_left=1.104, terminated=True)
    assert label == "discretization_error"
    assert "period 0.05 s was terminated at 1.104 s" in reason
    for other in ({"goal_left": 0.9, "terminated": True}, {"goal_left": 1.104}):
        assert "last left it at" in _label(**fall, **other)[1]


def test_planning():
    label, reason = _label()
    assert label == "planning_error"
    assert "never reached" in reason
    assert "10 %" in reason
    label, reason = _label(goal_reached=9.0, goal_since=9.0)
    assert label == "planning_error"
    assert "too late" in reason


RULES = (
    ({"solver_status": "diverged"}, {}, "evaluation_error"),
    ({"success": True}, {}, "none"),
    ({}, {"cell_status": "unachievable"}, "unachievable"),
    ({}, {"home_success": 0.25}, "not_learned"),
    ({}, {"second_horizon": True}, "too_slow"),
    ({}, {"home": True}, "discretization_error"),
    ({"observation_noise": 0.1}, {"without_noise": True}, "perception_error"),
    ({"staleness": 0.1}, {"without_delay": True}, "state_error"),
    ({"goal_reached": 1.0, "goal_left": 2.0}, {}, "control_error"),
    ({}, {}, "planning_error"),
)


@given(st.sets(st.sampled_from(range(len(RULES)))))
def test_the_first_rule_that_fits_is_taken(chosen):
    facts, said = {}, {}
    for rule in chosen:
        facts |= RULES[rule][0]
        said |= RULES[rule][1]
    label, _ = failure_label(replace(FAILED, **facts), replace(EVERYTHING, **said))
    assert label == RULES[min(chosen, default=len(RULES) - 1)][2]


def test_every_label_has_its_rule():
    assert {label for *_, label in RULES} == set(LABELS) - {"unattributed"}


known = st.one_of(st.none(), st.booleans())
shares = st.floats(0.0, 1.0)
times = st.one_of(st.none(), shares)


@given(
    st.builds(
        EpisodeFacts,
        success=st.booleans(),
        goal=st.just("goal"),
        discretization=st.just("somewhere"),
        time=shares,
        episode_return=st.one_of(st.none(), st.floats(-9.0, 9.0)),
        solver_status=st.sampled_from(["ok", "not_converged", "diverged"]),
        saturated_share=shares,
        goal_reached=times,
        goal_left=times,
        goal_since=times,
        observation_noise=shares,
        staleness=shares,
    ),
    st.builds(
        Replays,
        home=st.one_of(known, st.sampled_from(["is home", "no home"])),
        without_noise=known,
        without_delay=known,
        second_horizon=known,
        home_success=st.one_of(st.none(), shares),
        cell_status=st.one_of(st.none(), st.sampled_from(CELL_STATUSES)),
    ),
)
def test_every_episode_has_one_label_and_a_reason(facts, replays):
    label, reason = failure_label(facts, replays)
    assert label in LABELS
    assert reason
    broken = facts.solver_status == "diverged" or facts.episode_return is None
    assert (label == "none") == (facts.success and not broken)
    if label == "unattributed":
        assert "not run" in reason
        assert None in (replays.home, replays.without_noise, replays.without_delay)


@pytest.mark.parametrize("home", [True, False, None, "is home", "no home"])
def test_what_is_known_beside_the_episode_is_a_field_of_its_record(home):
    """Where the episode ran at home, or has none, there was no replay at home."""
    assert Replays(home=home).columns() == {
        "replay_home": home if isinstance(home, bool) else None,
        "replay_without_noise": None,
        "replay_without_delay": None,
        "replay_second_horizon": None,
        "home_success": None,
        "cell_status": None,
    }


def test_every_field_of_replays_is_a_column():
    said = replace(
        EVERYTHING, home=True, without_delay=True, home_success=0.75, cell_status="undecided"
    )
    assert list(said.columns().values()) == list(vars(said).values())
    names = [field.name for field in SUMMARY_FIELDS if field.group == "replays"]
    assert list(said.columns()) == names
