"""Pinocchio: what its `aba` is told, and what it is not asked to do."""

import gymnasium as gym
import numpy as np
import pytest
from engine_cases import DAMPING, IDS, needs, setup_of, states

from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.registries import INTEGRATORS

pytestmark = pytest.mark.usefixtures("pinocchio")

ROUGH = {
    "dt": 0.002, "control_period": 0.02, "friction": 0.02, "cart_friction": 0.4, "damping": 0.01,
    "cart_damping": 0.3,
}  # fmt: skip
"""A cart-pole with everything that resists it, in short steps."""


@pytest.fixture(scope="module", name="pinocchio")
def _pinocchio():
    needs("pinocchio")


@pytest.mark.parametrize("env_id", IDS)
def test_its_jacobian_is_that_of_its_accelerations(env_id):
    setup = setup_of("pinocchio", "implicit_midpoint", env_id, **DAMPING[env_id])
    plant, n = setup.engine.system.plant, len(setup.plant.coordinates)
    for q, v, control in states(setup, 5):
        force = setup.system.to_generalized_force((control,))
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


def test_an_integrator_of_the_users_own():
    own = "integ_gym.envs.engines.maps:Heun"
    ends = []
    for engine in ("pinocchio", "native"):
        env = gym.make("IntegCartPole-v0", engine=engine, integrator=own, dt=0.05)
        env.reset(seed=1)
        env.step(1)
        ends.append(env.unwrapped.state)
    np.testing.assert_allclose(*ends, rtol=0, atol=1e-13)
