"""All installed engines in one process."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from engine_cases import EVERY, FIRST, IDS

from integ_gym.envs.engines import missing_modules
from integ_gym.train.fleet.worker import default_cache_dir

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
    "cases", [pytest.param(EVERY, marks=pytest.mark.slow), FIRST], ids=["every", "first"]
)
def test_every_engine_steps_both_plants_in_one_process(cases, tmp_path):
    """Built one after another, then stepped in turn: silently, and to the end.

    One integrator of each engine; every one in `make test-slow`. What JAX compiles is kept in a
    folder that no other process writes to: reading what is half written is not silent.
    """
    installed = [case for case in cases if not missing_modules(case[0])]
    if not installed:
        pytest.skip("no engine but the native one is installed")
    script = SCRIPT.format(cases=installed, ids=IDS)
    kept = {
        "JAX_COMPILATION_CACHE_DIR": str(default_cache_dir() / "engines_together"),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
    }
    done = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True, text=True, check=False, cwd=tmp_path, env={**os.environ, **kept},
    )  # fmt: skip
    assert (done.returncode, done.stdout + done.stderr) == (0, "")
    assert not list(tmp_path.iterdir())
