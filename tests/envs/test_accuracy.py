"""Driven, damped motion: convergence to the reference and the energy ledger."""

from __future__ import annotations

from math import pi

import gymnasium as gym
import numpy as np
import pytest
from motions import DRIVEN_PLANTS, EXPLICIT_ORDERS, STARTS, driven
from scipy.integrate import solve_ivp

import integ_gym
from integ_gym.envs.engines.native import NativeEngine
from integ_gym.envs.ops import SCALAR
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.system import PlantSystem

SUBSTEPS = (16, 32, 64, 128)


def _slope(errors: list[float]) -> float:
    """Order of convergence over the two finest halvings that are above rounding."""
    usable = [e for e in errors if e > 1e-12]
    return float(np.log2(usable[-2] / usable[-1]))


@pytest.mark.parametrize("plant", DRIVEN_PLANTS)
@pytest.mark.parametrize("integrator", EXPLICIT_ORDERS)
def test_halving_dt_converges_to_the_reference(plant, integrator):
    q, v = STARTS[plant]
    truth, _ = driven(DRIVEN_PLANTS[plant], "reference", 1, q, v)
    errors = [
        float(np.abs(driven(DRIVEN_PLANTS[plant], integrator, n, q, v)[0] - truth).max())
        for n in SUBSTEPS
    ]
    assert _slope(errors) == pytest.approx(EXPLICIT_ORDERS[integrator], abs=0.1)


@pytest.mark.parametrize("plant", DRIVEN_PLANTS)
@pytest.mark.parametrize("integrator", EXPLICIT_ORDERS)
def test_energy_residual_falls_at_the_order(plant, integrator):
    q, v = STARTS[plant]
    residuals = [driven(DRIVEN_PLANTS[plant], integrator, n, q, v)[1] for n in SUBSTEPS]
    order = EXPLICIT_ORDERS[integrator]
    assert _slope(residuals) > order - 0.1
    assert residuals[-1] < residuals[0] / 2 ** (3 * (order - 0.2))


@pytest.mark.parametrize("plant", DRIVEN_PLANTS)
def test_reference_does_not_depend_on_dt(plant):
    q, v = STARTS[plant]
    coarse, _ = driven(DRIVEN_PLANTS[plant], "reference", 1, q, v)
    fine, _ = driven(DRIVEN_PLANTS[plant], "reference", 4, q, v)
    assert np.abs(coarse - fine).max() < 1e-11


@pytest.mark.parametrize("plant", DRIVEN_PLANTS)
def test_reference_agrees_with_dop853_on_every_plant(plant):
    q, v = STARTS[plant]
    system, n = PlantSystem(DRIVEN_PLANTS[plant]), len(q)
    motion = NativeEngine(system, "reference", 0.05).advance(SCALAR, q, v, ((1.7, 1),), None)

    def slope(t, y):
        acceleration, power = system.rates(SCALAR, tuple(y[:n]), tuple(y[n : 2 * n]), 1.7)
        return (*y[n : 2 * n], *acceleration, *power)

    truth = solve_ivp(slope, (0.0, 0.05), (*q, *v, 0.0), "DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    got = np.array([*motion.q, *motion.v, *motion.losses])
    assert np.abs(got - truth).max() < 1e-10


@pytest.mark.parametrize("spin", [0.0, 12.0, 60.0, 200.0])
def test_reference_agrees_with_dop853(spin):
    plant = Pendulum(damping=0.3)
    engine = NativeEngine(PlantSystem(plant), "reference", 0.05)
    motion = engine.advance(SCALAR, (1.0,), (spin,), ((1.7, 1),), None)
    truth = solve_ivp(
        lambda t, y: (y[1], 15.0 * np.sin(y[0]) + 3.0 * (1.7 - 0.3 * y[1]), 0.3 * y[1] ** 2),
        (0.0, 0.05), (1.0, spin, 0.0), "DOP853", rtol=1e-13, atol=1e-13,
    ).y[:, -1]  # fmt: skip
    got = (motion.q[0], motion.v[0], motion.losses[0])
    assert np.abs(np.array(got) - truth).max() < 1e-10


@pytest.mark.parametrize("env_id", integ_gym.ENVIRONMENTS)
def test_reference_residual_with_damping_drive_and_fast_spin(env_id):
    env = gym.make(env_id, integrator="reference", dt=0.05, damping=0.05).unwrapped
    env.action_space.seed(1)
    env.reset(seed=1)
    state = np.zeros_like(env.state)
    state[-1] = 60.0
    env.reset(options={"state": state})
    for _ in range(100):
        *_, info = env.step(env.action_space.sample())
        assert abs(info["energy_residual"]) < 1e-9
        assert info["solver_status"] == "ok"
    assert info["energy"] > 0.0


def test_ledger_terms_agree_with_an_independent_integral():
    """Work and dissipation over one period against a quadrature made by `solve_ivp`."""
    env = gym.make(
        "IntegPendulum-v0", integrator="rk4", dt=0.0125, control_period=0.05, damping=0.4
    )
    env.reset(options={"state": (pi - 1.0, 4.0)})
    *_, info = env.step(np.array([1.5]))
    truth = solve_ivp(
        lambda t, y: (
            y[1],
            15.0 * np.sin(y[0]) + 3.0 * (1.5 - 0.4 * y[1]),
            1.5 * y[1],
            0.4 * y[1] ** 2,
        ),
        (0.0, 0.05), (pi - 1.0, 4.0, 0.0, 0.0), "DOP853", rtol=1e-13, atol=1e-13,
    ).y[:, -1]  # fmt: skip
    assert info["actuator_work"] == pytest.approx(truth[2], abs=1e-7)
    assert info["dissipated"] == pytest.approx(truth[3], abs=1e-7)
