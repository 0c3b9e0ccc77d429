"""Tasks of other libraries as testbeds: what is applied is what was asked, or it is refused."""

from __future__ import annotations

import json
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
from integ_gym.envs.testbeds.making import find_testbed, make_checked

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
print(json.dumps(told))
"""


@pytest.mark.slow
@pytest.mark.parametrize("library", TASKS)
def test_a_task_of_a_library_applies_what_was_asked(library: str, tmp_path: Path) -> None:
    pytest.importorskip(MODULES.get(library, library))
    env_id, integrator = TASKS[library]
    command = [sys.executable, "-W", "ignore", "-c", SCRIPT, env_id, integrator]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
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
