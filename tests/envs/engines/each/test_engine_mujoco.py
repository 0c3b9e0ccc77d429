"""MuJoCo: no memory between steps, no cap on speed, silence, and its solver's report."""

from __future__ import annotations

import subprocess
import sys

import pytest
from engine_cases import needs
from engine_checks import new_setup

import integ_gym  # noqa: F401
from integ_gym.envs.engines.mujoco import MujocoEngine
from integ_gym.envs.ops.ops import SCALAR

ALL = tuple(MujocoEngine.maps)
STOPPED = {"env_id": "IntegCartPoleSwingUp-v0", "contact": "engine", "dt": 0.001}


AGAINST = ((2.41, 0.3), (1.0, 5.0), (((2.0,), 1),), None)


@pytest.fixture(autouse=True)
def _installed():
    needs("mujoco")


@pytest.mark.parametrize("integrator", ALL)
def test_a_solver_that_is_stopped_at_its_cap_has_not_converged(integrator):
    engine = new_setup("mujoco", integrator, **STOPPED).engine
    assert engine.advance(SCALAR, *AGAINST).converged
    cut = new_setup("mujoco", integrator, **STOPPED).engine
    cut._model.opt.iterations = 1
    motion = cut.advance(SCALAR, *AGAINST)
    assert (motion.iterations, motion.converged) == (1, False)
    free = new_setup("mujoco", integrator, "IntegCartPole-v0").engine
    assert not free.reports
    assert free.solver() == {"solver_tolerance": None, "solver_cap": None}


STIFF = {
    "pendulum": ("IntegPendulum-v0", {"damping": 50.0, "dt": 0.05, "control_period": 0.5},
                 (0.5, 8.0)),
    "cart-pole": ("IntegCartPole-v0", {"damping": 100.0, "dt": 0.1, "control_period": 1.0},
                  (0.0, 1.0, 0.1, 8.0)),
}  # fmt: skip
"""Explicit stages in which damping makes the motion explode, under forces of ordinary size."""


EXPLOSION = """
import gymnasium, integ_gym
for id, given, state in {stiff!r}:
    env = gymnasium.make(id, engine="mujoco", integrator="RK4", disable_env_checker=True, **given)
    for _ in range(3):
        env.reset(seed=0, options={{"state": state}})
        *_, info = env.step(env.action_space.sample())
        assert info["solver_status"] == "diverged", info
"""


def test_a_motion_that_explodes_within_a_step_is_not_written_about(tmp_path):
    command = [sys.executable, "-c", EXPLOSION.format(stiff=list(STIFF.values()))]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert (done.returncode, done.stdout + done.stderr) == (0, "")
    assert not list(tmp_path.iterdir())
