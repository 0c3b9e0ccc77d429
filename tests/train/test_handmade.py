"""Hand-made controllers: what they reach on the truth, and how."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from playing import CART_POLE, ELASTIC, PENDULUM, SWING_UP, TIGHT, play

from integ_gym.train.controllers import EnergyShaping

pytest.importorskip("scipy")


RK4 = {"integrator": "rk4"}
POINT = {"mass_distribution": "point"}
SUCCEEDS: list[tuple[str, dict[str, Any]]] = [
    *(
        (PENDULUM, TIGHT | RK4 | {"max_torque": 1.0} | given)
        for given in (
            {"integrator": "explicit_euler"},
            {"dt": 0.01, "control_period": 0.05},
            {"dt": 0.1},
            {"start": "uniform", "max_torque": 0.8},
            {"mass": 1.3, "length": 0.7, "gravity": 9.81, "damping": 0.02},
            POINT | {"gravity": 9.81, "max_torque": 20.0},
            {"observation_noise": 0.02},
        )
    ),
    *(
        (CART_POLE, {"integrator": "reference", "dt": 0.02} | given)
        for given in (
            {},
            RK4 | {"dt": 0.005, "control_period": 0.02, "duration": 40.0},
            {"dt": 0.05},
            {"integrator": "explicit_euler"},
            POINT | {"length": 0.8, "mass": 0.3, "cart_damping": 0.1},
        )
    ),
    *(
        (ELASTIC, {"dt": 0.02} | given)
        for given in (
            {"integrator": "reference"},
            {"integrator": "implicit_euler", "dt": 0.05},
            {"stiffness": 100.0, "damping": 0.1},
            {"control_period": 0.1},
        )
    ),
    *(
        (SWING_UP, RK4 | {"dt": 0.005, "control_period": 0.02} | given)
        for given in (
            {},
            {"control_period": 0.05},
            {"integrator": "reference", "dt": 0.02},
            {"integrator": "explicit_euler", "dt": 0.02},
            {"max_force": 5.0},
            {"mass": 0.3, "length": 0.8},
            POINT | {"damping": 0.003},
            {"friction": 0.02, "cart_friction": 0.5},
            {"track_limit": 1.2, "observation_noise": 0.01},
            {"start": "upright"},
        )
    ),
]


@pytest.mark.parametrize(("env_id", "arguments"), SUCCEEDS, ids=str)
def test_success_wherever_it_is_played(env_id, arguments):
    result = play(env_id, "handmade", 20, **arguments)
    assert result.success == 1.0
    assert env_id != SWING_UP or result.since.max() <= 7.0


@pytest.mark.parametrize(
    ("max_torque", "latest"), [(0.7, 8.0), (0.8, 7.6), (1.0, 6.0), (1.25, 4.6), (2.0, 4.2)]
)
def test_swing_up_under_tight_torque_limits(max_torque, latest):
    result = play(PENDULUM, "handmade", **TIGHT, max_torque=max_torque)
    assert result.success == 1.0
    assert result.since.max() <= latest
    assert np.abs(result.controls).max() <= max_torque


def test_where_the_integrator_drains_energy_no_skill_is_needed():
    """A success that is the simulator's own: without control, and only there."""
    assert play(ELASTIC, "zero", 20, integrator="implicit_euler", dt=0.05).success == 1.0
    assert play(ELASTIC, "zero", 20, integrator="reference", dt=0.05).success == 0.0


@pytest.mark.parametrize("missing", [-0.1, 0.1])
@pytest.mark.parametrize(("theta", "direction"), [(2.0, 1), (-2.5, -1), (math.pi, 1), (1.2, -1)])
def test_pumping_does_the_work_that_is_missing(theta, direction, missing):
    """Where the torque suffices, one period brings the energy to that of standing upright."""
    env = gym.make(PENDULUM, integrator="reference", dt=0.01, max_torque=5.0, damping=0.3)
    controller = EnergyShaping(env.unwrapped.setup)
    plant = controller.plant
    upright = 2.0 * plant.gravity_torque
    kinetic = upright - missing - plant.gravity_torque * (1.0 + math.cos(theta))
    theta_dot = direction * math.sqrt(2.0 * kinetic / plant.inertia)
    env.reset(options={"state": (theta, theta_dot)})
    torque = controller.pump(np.array([theta]), np.array([theta_dot]))
    *_, info = env.step(torque)
    assert info["energy"] == pytest.approx(upright, abs=0.03 * abs(missing))


def test_the_regulator_takes_over_only_where_it_catches():
    """From every state that it claims, the regulator alone brings the plant to rest upright."""
    env = gym.make(PENDULUM, **TIGHT, max_torque=0.8, duration=6.0)
    controller = EnergyShaping(env.unwrapped.setup)
    rng = np.random.default_rng(0)
    angle, speed = rng.uniform(-1.2, 1.2, 4000), rng.uniform(-6.0, 6.0, 4000)
    claimed = np.flatnonzero(controller.region.holds(angle, speed))
    assert 20 < claimed.size < 1000
    assert controller.region.holds(np.array([0.0]), np.array([0.0])).all()
    for index in claimed[:20]:
        env.reset(options={"state": (angle[index], speed[index])})
        truncated = False
        while not truncated:
            theta, theta_dot = env.unwrapped.state
            torque = controller.regulate(np.array([theta]), np.array([theta_dot]))
            *_, truncated, info = env.step(torque)
        assert info["success"]
