"""MuJoCo: no memory between steps, no cap on speed, silence, and its solver's report."""

import subprocess
import sys

import pytest
from engine_cases import FIRST, TOLERANCE, lighter, needs, setup_of, states
from engine_checks import defect, new_setup

import integ_gym  # noqa: F401
from integ_gym.envs.engines.mujoco import MujocoEngine
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.registries import ENGINES

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


PENDULUM = "IntegPendulum-v0"
FLOORED = ("mujoco", "mujoco_warp", "newton")


def _light(setup):
    """(q, v, control) at random, with torques that fit a light pendulum."""
    inertia = setup.plant.mass * setup.plant.length**2
    return [(q, v, inertia * control) for q, v, control in states(setup)]


@pytest.mark.parametrize(("engine", "integrator"), lighter([*FIRST, ("newton", "mujoco_euler")]))
def test_a_gram_on_a_string_moves_as_the_map_does(engine, integrator):
    setup = setup_of(engine, integrator, PENDULUM, mass_distribution="point", mass=1e-3, length=0.2)
    assert defect(setup, _light(setup)) <= TOLERANCE[setup.engine.width]


@pytest.mark.parametrize(
    ("engine", "integrator"), lighter([x for x in FIRST if ENGINES.load(x[0]).width == 64])
)
def test_a_light_pole_keeps_its_inertia_beside_a_heavy_cart(engine, integrator):
    """In float64: a mass matrix of such different entries is not solved with in float32."""
    pole = {"mass_distribution": "point", "mass": 1e-3, "length": 0.1}
    setup = setup_of(engine, integrator, "IntegCartPole-v0", **pole)
    assert defect(setup, states(setup)) <= TOLERANCE[64]


@pytest.mark.parametrize("engine", FLOORED)
def test_what_is_too_light_is_refused_with_the_reason(engine):
    needs(engine)
    integrator = next(iter(ENGINES.load(engine).maps))
    with pytest.raises(
        ValueError, match=r"no body's moment of inertia below 1\.1e-15 kg m\^2.*use"
    ):
        new_setup(engine, integrator, PENDULUM, mass_distribution="point", mass=1e-9, length=1e-3)
