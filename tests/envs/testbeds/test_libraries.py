"""Tasks of other libraries as testbeds: what is applied is what was asked, or it is refused."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

TASKS = {
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
@pytest.mark.parametrize("library", TASKS)
def test_a_task_of_a_library_applies_what_was_asked(library: str, tmp_path: Path) -> None:
    pytest.importorskip(MODULES.get(library, library))
    env_id, integrator = TASKS[library]
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
