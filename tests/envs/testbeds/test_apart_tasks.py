"""Tasks of libraries with environments of their own, from recorded exchanges, and without one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from apart_scenarios import SCENARIOS
from exchanges import replayed

from integ_gym.envs.settings import Discretization
from integ_gym.envs.testbeds import making
from integ_gym.envs.testbeds.gym_testbed import Applied
from integ_gym.envs.testbeds.making import make_checked
from integ_gym.support.isolated import IsolatedEnvironment, Worker, WorkerError

HOMES = {
    "dm_control": Discretization("RK4", 0.01, 0.01, "dm_control"),
    "isaaclab": Discretization("implicitfast", 1 / 120, 1 / 60, "isaaclab"),
}
OTHERS = {
    "dm_control": Discretization("Euler", 0.005, 0.01, "dm_control"),
    "isaaclab": Discretization("rk4", 1 / 240, 1 / 60, "isaaclab"),
}
TASKS = {
    "dm_control": "dm_control:cartpole.swingup",
    "isaaclab": "isaaclab:Isaac-Cartpole-Direct",
}

each = pytest.mark.parametrize("library", HOMES)


@pytest.fixture(autouse=True)
def _fresh():
    """Testbeds are not those that another test made."""
    making._load_testbed.cache_clear()
    yield
    making._load_testbed.cache_clear()


@each
def test_a_task_applies_what_was_asked(library):
    with replayed(f"{library}_task"):
        found = SCENARIOS[f"{library}_task"]()
    home, other = HOMES[library], OTHERS[library]
    assert found["home"] == home.arguments()
    for asked, name in ((home, "stock"), (other, "other")):
        substeps = round(asked.control_period / asked.dt)
        assert found[name] == Applied(asked, substeps)
        first, again = found[f"{name} episodes"]
        assert first == again
        (start,), *steps = first
        assert start[0] != start[1]
        assert steps[-1][0] != start
        assert np.isfinite([step[1] for step in steps]).all()
    assert found["stock episodes"] != found["other episodes"]


def _testbed(library, **arguments):
    return making.find_testbed(TASKS[library], arguments)


@each
def test_lanes_share_a_process_that_ends_with_them(library):
    with replayed(f"{library}_task"):
        testbed = _testbed(library)
        environments = make_checked(testbed, testbed.home, 2)
        (worker,) = {env.unwrapped.worker for env in environments.unwrapped.envs}
        process = worker._process
        assert process.poll() is None
        environments.close()
        del environments, worker
    assert process.poll() is not None


@each
def test_a_step_that_does_not_divide_is_refused_before_it_is_asked_for(library):
    with replayed(f"{library}_task"):
        testbed = _testbed(library)
        with pytest.raises(ValueError, match="is not a whole multiple"):
            make_checked(testbed, replace(testbed.home, dt=testbed.home.dt * 0.7), 1)
        with pytest.raises(ValueError, match=r"unknown integrator of .* 'leapfrog'"):
            make_checked(testbed, replace(testbed.home, integrator="leapfrog"), 1)


@each
def test_a_process_that_is_lost_is_an_error_and_no_reward(library):
    with replayed(f"{library}_task"):
        testbed = _testbed(library)
        environments = make_checked(testbed, testbed.home, 2)
        assert testbed.applied(environments).discretization == testbed.home
        environments.reset(seed=3)
        with pytest.raises(WorkerError, match=f"{library} failed in `step`: not in the recording"):
            environments.step(np.full(environments.action_space.shape, 0.75, np.float32))
        environments.unwrapped.envs[0].unwrapped.worker._process.kill()
        with pytest.raises(WorkerError, match=f"{library} ended with exit code -9"):
            environments.step(np.full(environments.action_space.shape, 0.25, np.float32))
        environments.close()


@each
def test_without_its_environment_one_sentence_says_what_sets_it_up(library):
    with pytest.raises(ModuleNotFoundError, match=f"run: make {library} ") as told:
        _ = _testbed(library).home
    assert "\n" not in str(told.value)


class Stale(Worker):
    """A process whose library keeps its own number of steps, whatever the step is."""

    def call(self, method, *given, **more):
        told = super().call(method, *given, **more)
        if method == "applied":
            return {**told, "substeps": 1, "control_period": told["dt"]}
        return told


def test_a_stale_number_of_steps_is_refused(monkeypatch):
    """As that of an environment of dm_control whose step is changed after it was made."""
    with replayed("dm_control_task"):
        start = IsolatedEnvironment.start

        def stale(apart, served):
            worker = start(apart, served)
            worker.__class__ = Stale
            return worker

        monkeypatch.setattr(IsolatedEnvironment, "start", stale)
        testbed = _testbed("dm_control")
        make_checked(testbed, testbed.home, 2).close()
        with pytest.raises(ValueError, match=r"`control_period`=0.01 was asked.* applies 0.005;"):
            make_checked(testbed, OTHERS["dm_control"], 2)
        monkeypatch.undo()
