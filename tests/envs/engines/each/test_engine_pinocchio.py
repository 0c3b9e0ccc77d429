"""Pinocchio: what its `aba` is told, and what it is not asked to do."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from engine_cases import DAMPING, IDS, needs, setup_of, states

from integ_gym.envs.engines.pinocchio import ArticulatedBodies
from integ_gym.envs.integrators import newton as _newton
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.registries import INTEGRATORS
from integ_gym.envs.steps import traced
from integ_gym.envs.transition import scalar_step

pytestmark = pytest.mark.usefixtures("pinocchio")

ROUGH = {
    "dt": 0.002, "control_period": 0.02, "friction": 0.02, "cart_friction": 0.4, "damping": 0.01,
    "cart_damping": 0.3,
}  # fmt: skip
"""A cart-pole with everything that resists it, in short steps."""


@pytest.fixture(scope="module", name="pinocchio")
def _pinocchio():
    needs("pinocchio")


def test_aba_leaves_the_models_damping_out_and_we_put_it_in():
    plant = CartPole(damping=0.02, cart_damping=0.4)
    bodies, free = ArticulatedBodies(plant.mechanism), ArticulatedBodies(CartPole().mechanism)
    q, v, force = (0.3, -0.7), (2.0, -3.0), (0.5, 0.0)
    alone = free.accelerations(SCALAR, q, v, force)
    free._model.damping = np.array([0.4, 0.02])
    assert free.accelerations(SCALAR, q, v, force) == alone
    expected = plant.acceleration(SCALAR, q, v, force)
    np.testing.assert_allclose(bodies.accelerations(SCALAR, q, v, force), expected, rtol=1e-13)
    assert abs(np.subtract(expected, alone)).min() > 0.1


@pytest.mark.parametrize("env_id", IDS)
def test_its_jacobian_is_that_of_its_accelerations(env_id):
    setup = setup_of("pinocchio", "implicit_midpoint", env_id, **DAMPING[env_id])
    plant, n = setup.engine.system.plant, len(setup.plant.coordinates)
    for q, v, control in states(setup, 5):
        force = setup.system.generalized(control)
        by_q, by_v = plant.jacobian(SCALAR, q, v, force)
        for j in range(n):
            for part, found in ((0, by_q), (1, by_v)):
                ends = []
                for side in (1e-5, -1e-5):
                    moved = [list(q), list(v)]
                    moved[part][j] += side
                    ends.append(plant.acceleration(SCALAR, *moved, force))
                slope = np.subtract(*ends) / 2e-5
                np.testing.assert_allclose([row[j] for row in found], slope, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("integrator", INTEGRATORS.names())
def test_friction_and_stops_act_as_in_the_native_engine(integrator):
    """Within the integrator's stages: an episode that hits a stop is the native one."""
    told = []
    for engine in ("pinocchio", "native"):
        env = gym.make("IntegCartPoleSwingUp-v0", engine=engine, integrator=integrator, **ROUGH)
        env.reset(seed=0, options={"state": (2.3, 2.0, np.pi - 0.5, 1.0)})
        told.append([env.step(np.array([1.0]))[4] for _ in range(20)])
        told[-1].append({"state": env.unwrapped.state})
    ours, known = told
    np.testing.assert_allclose(ours.pop()["state"], known.pop()["state"], rtol=0, atol=1e-9)
    assert max(info["penetration"] for info in ours) > 0.0
    for a, b in zip(ours, known, strict=True):
        assert a["solver_status"] == b["solver_status"]
        for name in ("energy", "dissipated", "contact_loss", "energy_residual", "penetration"):
            assert a[name] == pytest.approx(b[name], abs=1e-9), name


@pytest.mark.parametrize("integrator", INTEGRATORS.names())
def test_its_steps_are_traced(integrator):
    assert traced(setup_of("pinocchio", integrator, "IntegCartPole-v0"), scalar_step) is not None


def test_more_lanes_than_its_parallel_algorithm_survives():
    """`abaInParallel` ends the process at 128 and more: lanes are taken one by one."""
    ends = []
    for engine in ("pinocchio", "native"):
        env = gym.make_vec("IntegCartPole-v0", num_envs=130, engine=engine, dt=0.02)
        env.reset(seed=1)
        env.step(np.arange(130) % 2)
        ends.append(env.state)
    np.testing.assert_allclose(*ends, rtol=0, atol=1e-13)


def test_an_integrator_of_the_users_own():
    own = "integ_gym.envs.engines.maps:Heun"
    ends = []
    for engine in ("pinocchio", "native"):
        env = gym.make("IntegCartPole-v0", engine=engine, integrator=own, dt=0.05)
        env.reset(seed=1)
        env.step(1)
        ends.append(env.unwrapped.state)
    np.testing.assert_allclose(*ends, rtol=0, atol=1e-13)


def test_the_solver_tells_of_a_step_that_its_cap_cut_short(monkeypatch):
    monkeypatch.setattr(_newton, "CAP", 1)
    env = gym.make(
        "IntegCartPole-v0", engine="pinocchio", integrator="implicit_euler", dt=0.05,
        disable_env_checker=True,
    )  # fmt: skip
    env.reset(options={"state": (0.0, 1.0, 1.0, 5.0)})
    info = env.step(1)[4]
    assert info["solver_status"] == "not_converged"
    assert info["solver_iterations"] == 1
    assert info["solver_residual"] > _newton.TOLERANCE


def test_a_plant_without_links_is_refused():
    with pytest.raises(ValueError, match="use engine 'native' or 'casadi'"):
        gym.make("IntegElasticPendulum-v0", engine="pinocchio")
