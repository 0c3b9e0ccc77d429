"""Dry friction: force, power, and how the integrators carry it."""

from math import tanh

import gymnasium as gym
import numpy as np
import pytest
from motions import ALL

from integ_gym.envs.engines.stepping import NativeEngine
from integ_gym.envs.ops.ops import ARRAY, SCALAR
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.plants.system import PlantSystem

IMPLICIT = ("implicit_euler", "implicit_midpoint", "stormer_verlet")


@pytest.mark.parametrize("v", [-2.0, -0.01, 0.0, 0.004, 3.0])
def test_power_is_force_times_speed(v):
    plant = Pendulum(gravity=0.0, friction=0.6)
    (acceleration,), (power,) = PlantSystem(plant).rates(SCALAR, (0.3,), (v,), (0.0,))
    force = -0.6 * tanh(v / 0.01)
    assert acceleration == pytest.approx(force / plant.inertia)
    assert power == pytest.approx(-force * v)
    assert power >= 0.0


@pytest.mark.parametrize("friction_speed", [0.01, 0.1])
def test_reference_ledger_with_friction(friction_speed):
    env = gym.make(
        "IntegCartPoleSwingUp-v0", integrator="reference", friction=0.02, cart_friction=1.0,
        friction_speed=friction_speed,
    )  # fmt: skip
    env.reset(seed=0)
    env.action_space.seed(0)
    total = 0.0
    for _ in range(60):
        *_, info = env.step(env.action_space.sample())
        assert abs(info["energy_residual"]) < 1e-9
        assert info["dissipated"] >= 0.0
        total += info["dissipated"]
    assert total > 0.1


@pytest.mark.parametrize("integrator", IMPLICIT)
@pytest.mark.parametrize(
    "plant",
    [
        Pendulum(friction=1.0),
        Pendulum(friction=0.5, joint_limit=1.0, stop_stiffness=1e4),
        CartPole(cart_friction=2.0, friction=0.02),
        CartPole(cart_friction=1.0, track_limit=1.0, stop_stiffness=1e4),
    ],
    ids=["hinge", "hinge and stop", "cart and hinge", "cart and stop"],
)
def test_newton_copes_with_friction_and_stops(integrator, plant):
    """From slow, fast and touching states, at a coarse and a fine step."""
    rng = np.random.default_rng(0)
    n, lanes = len(plant.coordinates), 200
    for speed in (0.01, 3.0):
        q = tuple(rng.uniform(-1.02, 1.02, lanes) for _ in range(n))
        v = tuple(speed * rng.normal(size=lanes) for _ in range(n))
        control = rng.uniform(-5.0, 5.0, lanes)
        for dt in (0.01, 0.05):
            engine = NativeEngine(PlantSystem(plant), integrator, dt)
            motion = engine.advance(ARRAY, q, v, (((control,), 1),), None)
            converged = np.broadcast_to(motion.converged, lanes)
            assert converged.mean() > 0.99
            assert np.asarray(motion.residual)[converged].max() <= 1e-10


@pytest.mark.parametrize("integrator", ALL)
def test_single_and_vector_forms_agree_to_the_last_bit(integrator):
    arguments = {"integrator": integrator, "friction": 10.0, "dt": 0.5, "duration": 60.0}
    single = gym.make("IntegPendulum-v0", **arguments)
    many = gym.make_vec("IntegPendulum-v0", num_envs=2, **arguments)
    single.reset(seed=3)
    many.reset(seed=3)
    single.action_space.seed(0)
    for _ in range(60 if integrator != "reference" else 3):
        action = single.action_space.sample()
        *_, terminated, truncated, told = single.step(action)
        *_, info = many.step(np.stack([action, action]))
        state = many.unwrapped.state[0]
        np.testing.assert_array_equal(single.unwrapped.state, state)
        assert told["energy_residual"] == info["energy_residual"][0]
        if terminated or truncated:
            break
