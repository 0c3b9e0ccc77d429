"""All installed engines in one process."""

from __future__ import annotations

import subprocess
import sys

import pytest
from engine_cases import COMPILING, FIRST, IDS, lighter, needs
from engine_checks import told_by_an_episode

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


@pytest.mark.parametrize(
    ("engine", "integrator", "steps"),
    lighter([
        ("mujoco", "Euler", 20), ("mujoco", "RK4", 1), ("pybullet", "semi_implicit_euler", 1),
        ("sapien", "tgs", 1), ("mujoco_warp", "Euler", 1), ("newton", "mujoco_euler", 1),
    ]),
)  # fmt: skip
def test_of_a_divergence_nothing_is_printed_and_nothing_written(
    engine, integrator, steps, tmp_path
):
    needs(engine)
    assert told_by_an_episode(engine, integrator, tmp_path, steps) == (0, "")
