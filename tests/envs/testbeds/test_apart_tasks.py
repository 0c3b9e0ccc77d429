"""Tasks of libraries with environments of their own, from recorded exchanges, and without one."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

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


TASKS_HERE = {
    "playground": ("playground:CartpoleBalance", "RK4"),
    "brax": ("brax:inverted_pendulum", "spring"),
    "gymnasium_robotics": ("gymnasium_robotics:AdroitHandDoor-v1", "RK4"),
}
"""By library: a task and another integrator than its home's."""
MODULES = {"playground": "mujoco_playground"}

SCRIPT = """
import json, sys
from dataclasses import replace
import numpy as np
from integ_gym.envs.testbeds.making import (
    find_testbed, make_checked, make_training_environments
)
from wire import Wire

testbed = find_testbed(sys.argv[1], {})
home = testbed.home
other = replace(home, integrator=sys.argv[2], dt=home.dt / 2)
told = {"home": home.arguments(), "control_period": testbed.control_period}
for name, asked in (("stock", home), ("other", other)):
    environments = make_checked(testbed, asked, 2)
    runs = []
    for _ in range(2):
        first, _ = environments.reset(seed=3)
        action = np.full(environments.action_space.shape, 0.3, np.float32)
        runs.append([first, *(environments.step(action)[0] for _ in range(4))])
    setup = environments.setups[0]
    told[name] = {
        "applied": testbed.applied(environments).discretization.arguments(),
        "repeated": bool(np.array_equal(*map(np.array, runs))),
        "lanes_differ": bool((runs[0][0][0] != runs[0][0][1]).any()),
        "moved": bool((runs[0][0] != runs[0][-1]).any()),
        "last": runs[0][-1][0].tolist(),
        "version": setup.engine.version,
    }
    environments.close()
try:
    make_checked(testbed, replace(home, dt=home.dt * 0.7), 1)
except ValueError as error:
    told["refused"] = str(error)
period, shape = home.control_period, (1, *environments.single_action_space.shape)
told["late_home"] = find_testbed(sys.argv[1], {"action_latency": period}).home == home
delays = {"action_latency": period, "observation_latency": period, "hold_probability": 0.5}
late, plain = make_checked(testbed, home, 1, **delays), make_checked(testbed, home, 1)
arrived, shown, seen = [np.zeros(shape)], [late.reset(seed=[3])[0]], [plain.reset(seed=[3])[0]] * 2
for k in range(6):
    action = np.full(shape, 0.02 * k, np.float32)
    seen.append(plain.step(arrived[-1].astype(np.float32))[0])
    *_, info = late.step(action)
    shown.append(_[0])
    arrived.append(arrived[-1] if info["command_held"][0] else action)
told["late"] = [bool(np.array_equal(a, b)) for a, b in zip(shown, seen)]
told["lost"] = sum(a is b for a, b in zip(arrived, arrived[1:]))
try:
    split = make_checked(testbed, other, 1, action_latency=period / 2, hold_probability=0.3)
except ValueError as error:
    told["half"] = str(error)
else:
    if sys.argv[1].startswith("playground"):
        import jax
        from mujoco_playground._src import mjx_env
        kind, fine = type(split.unwrapped.envs[0].unwrapped.inner), replace(other, dt=home.dt / 4)
        step = kind.step
        kind.step = lambda task, state, action: step(task, state, 0.5 * action)
        told["split"], within = [], 0
        for latency, jitter in ((2, 0), (1, 6)):
            late = {"action_latency": latency * fine.dt, "latency_jitter": jitter * fine.dt}
            find = find_testbed(sys.argv[1], {"success_return": float(latency)})
            split = make_checked(find, fine, 1, **late, hold_probability=0.3)
            split.reset(seed=[25])
            wire = Wire(np.zeros(1), 4, latency, jitter, 0.3, 25)
            lane = split.unwrapped.envs[0].unwrapped
            model, data = lane.inner.mjx_model, lane._state.data
            advance = jax.jit(lambda data, control: mjx_env.step(model, data, control, 1))
            for k in range(8):
                action = np.full(shape, 0.3 * (-1) ** k + 0.02 * k, np.float32)
                *_, info = split.step(action)
                acting = wire.give(action[0])
                within += len({id(one) for one in acting}) > 2
                for one in acting:
                    data = advance(data, 0.5 * one)
                assert info["command_held"][0] == wire.held
                assert abs(info["command_latency"][0] - wire.late * fine.dt) < 1e-12
                gap = abs(lane._state.data.qvel - data.qvel).max()
                told["split"].append(float(gap / abs(data.qvel).max()))
        kind.step, told["within"] = step, within
        short = make_checked(find_testbed(sys.argv[1], {"episode_length": 20}), home, 1)
        told["short"] = short.setups[0].timing.horizon
mixture = [home.arguments(), other.arguments()]
mixed = make_training_environments(sys.argv[1], {"mixture": mixture}, 2)
alone = [make_checked(testbed, place, 1) for place in (home, other)]
told["mixed"] = []
for seed in (0, None, None):
    start, info = mixed.reset(seed=seed)
    action = np.full(mixed.action_space.shape, 0.3, np.float32)
    after = [start, *(mixed.step(action)[0] for _ in range(3))]
    for k, (lane, member) in enumerate(zip(mixed.envs, info["mixture_index"])):
        own, _ = alone[member].reset(seed=[lane.env.np_random_seed])
        then = [own, *(alone[member].step(action[:1])[0] for _ in range(3))]
        same = all(np.array_equal(one[k], two[0]) for one, two in zip(after, then))
        told["mixed"].append([int(member), same])
print(json.dumps(told))
"""


@pytest.mark.slow
@pytest.mark.parametrize("library", TASKS_HERE)
def test_a_task_of_a_library_applies_what_was_asked(library: str, tmp_path: Path) -> None:
    pytest.importorskip(MODULES.get(library, library))
    env_id, integrator = TASKS_HERE[library]
    command = [sys.executable, "-W", "ignore", "-c", SCRIPT, env_id, integrator]
    helpers = os.pathsep.join([*sys.path, os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        command, cwd=tmp_path, env={**os.environ, "PYTHONPATH": helpers},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout.splitlines()[-1])
    home = told["home"]
    assert told["stock"]["applied"] == home
    assert told["other"]["applied"] == {**home, "integrator": integrator, "dt": home["dt"] / 2}
    assert home["control_period"] == told["control_period"]
    for made in (told["stock"], told["other"]):
        assert [made[name] for name in ("repeated", "lanes_differ", "moved")] == [True] * 3
        assert made["version"] not in (None, "unknown")
    assert told["stock"]["last"] != told["other"]["last"]
    assert "ask for" in told["refused"] or "nearest valid" in told["refused"]
    assert told["late_home"] is True
    assert told["late"] == [True] * 7
    assert 0 < told["lost"] < 6
    assert ("whole multiple of `control_period`" in told.get("half", "")) == (library == "brax")
    assert max(told.get("split", [0.0])) < 1e-4
    assert len(told.get("split", [])) == 16 * (library == "playground")
    assert told.get("within", 2) == 2
    assert told.get("short", 20) == 20
    assert {member for member, _ in told["mixed"]} == {0, 1}
    assert all(same for _, same in told["mixed"])
