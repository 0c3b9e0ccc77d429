"""All installed engines in one process."""

from __future__ import annotations

import subprocess
import sys

import pytest
from engine_cases import COMPILING, FIRST, IDS

from integ_gym.envs.engines.stepping import missing_modules

SCRIPT = """
import math, warnings
import gymnasium as gym
import integ_gym

warnings.simplefilter("error")
cases, ids = {cases!r}, {ids!r}
envs = [
    gym.make(env_id, engine=engine, integrator=integrator, dt=0.02)
    for engine, integrator in cases
    for env_id in ids
]
for env in envs:
    env.reset(seed=0)
for _ in range(5):
    for env in envs:
        told = env.step(env.action_space.sample())
        assert math.isfinite(told[1]) and told[4]["solver_status"] != "diverged"
assert {{env.unwrapped.setup.settings.engine for env in envs}} == {{engine for engine, _ in cases}}
"""


@pytest.mark.parametrize(
    "cases",
    [pytest.param(FIRST, marks=pytest.mark.slow), [x for x in FIRST if x[0] not in COMPILING]],
    ids=["all", "light"],
)
def test_every_engine_steps_both_plants_in_one_process(cases, tmp_path):
    """Built one after another, then stepped in turn: silently, and to the end.

    Engines that compile nothing; all of them in `make test-slow`.
    """
    installed = [case for case in cases if not missing_modules(case[0])]
    if not installed:
        pytest.skip("no engine but the native one is installed")
    script = SCRIPT.format(cases=installed, ids=IDS)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert (done.returncode, done.stdout + done.stderr) == (0, "")
    assert not list(tmp_path.iterdir())
