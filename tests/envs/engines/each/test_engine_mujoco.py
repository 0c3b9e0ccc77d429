"""MuJoCo: no memory between steps, no cap on speed, silence, and its solver's report."""

from __future__ import annotations

import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest
from engine_cases import needs
from engine_checks import new_setup, told_by_an_episode

import integ_gym  # noqa: F401
from integ_gym.envs.engines.mujoco import MujocoEngine
from integ_gym.envs.ops.ops import SCALAR

ALL = tuple(MujocoEngine.maps)
STOPPED = {"env_id": "IntegCartPoleSwingUp-v0", "contact": "engine", "dt": 0.001}
AT_THE_STOP = [((x, 0.3), (1.0, 5.0), 2.0) for x in (2.41, 0.0, 2.5, -2.45, 2.4)]


@pytest.fixture(autouse=True)
def _installed():
    needs("mujoco")


def _against_the_stop(integrator, q, v, control, count=1, setup=None):
    setup = setup or new_setup("mujoco", integrator, **STOPPED)
    return setup.engine.advance(SCALAR, q, v, ((control, count),), None)


@pytest.mark.parametrize("integrator", ALL)
def test_a_step_against_the_stop_depends_on_nothing_that_went_before(integrator):
    """To the last bit, in any order, and after a state in which nothing is finite."""
    alone = [_against_the_stop(integrator, *case) for case in AT_THE_STOP]
    setup = new_setup("mujoco", integrator, **STOPPED)
    rng = np.random.default_rng(2)
    for k in rng.integers(0, len(AT_THE_STOP), 40):
        assert _against_the_stop(integrator, *AT_THE_STOP[k], setup=setup) == alone[k]
        setup.engine.run(1)(*[np.nan] * 6)
        setup.engine.run(1)(2.41, 0.3, 1e200, 1e200, 0.0, 0.0)


@pytest.mark.parametrize("integrator", ALL)
def test_what_the_constraint_solver_does_is_reported_where_there_is_one(integrator):
    stopped = gym.make(integrator=integrator, engine="mujoco", id=STOPPED["env_id"], dt=0.001,
                       control_period=0.02, contact="engine")  # fmt: skip
    stopped.reset(seed=0, options={"state": (2.35, 2.0, np.pi, 0.0)})
    told = [stopped.step(np.zeros(1, np.float32))[4] for _ in range(6)]
    assert {info["solver_status"] for info in told} == {"ok"}
    assert all((info["solver_iterations"] > 0) is bool(info["contact_force"]) for info in told)
    solver = stopped.unwrapped.setup.engine.solver()
    assert solver == {"solver_tolerance": 1e-8, "solver_cap": 100}
    free = new_setup("mujoco", integrator, "IntegCartPole-v0").engine
    assert not free.reports
    assert free.solver() == {"solver_tolerance": None, "solver_cap": None}


@pytest.mark.parametrize("integrator", ALL)
def test_a_solver_that_is_stopped_at_its_cap_has_not_converged(integrator):
    setup = new_setup("mujoco", integrator, **STOPPED)
    assert _against_the_stop(integrator, *AT_THE_STOP[0], setup=setup).converged
    cut = new_setup("mujoco", integrator, **STOPPED)
    cut.engine._model.opt.iterations = 1
    motion = _against_the_stop(integrator, *AT_THE_STOP[0], setup=cut)
    assert (motion.iterations, motion.converged) == (1, False)


@pytest.mark.parametrize("steps", [1, 20])
@pytest.mark.parametrize("integrator", ALL)
def test_nothing_is_printed_and_nothing_written(integrator, steps, tmp_path):
    assert told_by_an_episode("mujoco", integrator, tmp_path, steps) == (0, "")


STIFF = {
    "pendulum": ("IntegPendulum-v0", {"damping": 50.0, "dt": 0.05, "control_period": 0.5},
                 (0.5, 8.0)),
    "cart-pole": ("IntegCartPole-v0", {"damping": 100.0, "dt": 0.1, "control_period": 1.0},
                  (0.0, 1.0, 0.1, 8.0)),
}  # fmt: skip
"""Explicit stages in which damping makes the motion explode, under forces of ordinary size."""

EXPLOSION = """
import gymnasium, integ_gym
env = gymnasium.make({id!r}, engine="mujoco", integrator="RK4", disable_env_checker=True, **{given})
for _ in range(3):
    env.reset(seed=0, options={{"state": {state}}})
    *_, info = env.step(env.action_space.sample())
    assert info["solver_status"] == "diverged", info
"""


@pytest.mark.parametrize("name", STIFF)
def test_a_motion_that_explodes_within_a_step_is_not_written_about(name, tmp_path):
    env_id, given, state = STIFF[name]
    script = EXPLOSION.format(id=env_id, given=given, state=state)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert (done.returncode, done.stdout + done.stderr) == (0, "")
    assert not list(tmp_path.iterdir())
