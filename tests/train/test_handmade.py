"""Hand-made controllers: what they reach on the truth, and how."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from playing import CART_POLE, ELASTIC, HOPPER, PENDULUM, QUADROTOR, REACHER, SWING_UP, TIGHT, play

from integ_gym.train.baselines import make_baseline

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
        (HOPPER, RK4 | {"dt": 0.002, "control_period": 0.02} | given)
        for given in (
            {},
            {"integrator": "symplectic_euler", "dt": 0.001},
            {"integrator": "implicit_midpoint", "dt": 0.01, "control_period": 0.01},
            {"target_speed": 0.6},
            {"mass": 7.0, "leg_stiffness": 1800.0, "ground_friction": 0.6},
        )
    ),
    *(
        (QUADROTOR, {"integrator": "reference", "dt": 0.02} | given)
        for given in (
            {},
            {"motor_time_constant": None},
            {"way_point_period": 4.0, "duration": 12.0},
            {"integrator": "explicit_euler"},
            {"integrator": "implicit_euler", "dt": 0.04},
            {"mass": 0.5, "arm": 0.15, "inertia": 0.004, "damping": 0.0},
        )
    ),
    *(
        (REACHER, {"integrator": "reference", "dt": 0.04, "duration": 5.0} | given)
        for given in (
            {},
            RK4 | {"dt": 0.005, "control_period": 0.02, "servo": "step"},
            {"integrator": "explicit_euler", "dt": 0.02},
            RK4 | {"dt": 0.01, "gravity": 9.81, "damping": 0.5, "max_torque": 30.0},
            RK4 | {"mass_2": 2.0, "length_1": 0.6},
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


LANES = 40


@pytest.mark.parametrize("integrator", ["reference", "rk4"])
@pytest.mark.parametrize("env_id", ["IntegAcrobot-v0", "IntegAcrobotSwingUp-v0"])
def test_the_hand_made_controller_succeeds(env_id, integrator):
    envs = gym.make_vec(env_id, LANES, integrator=integrator)
    policy = make_baseline("handmade", envs.unwrapped.setup)
    observations, _ = envs.reset(seed=1)
    ended, succeeded = np.zeros(LANES, bool), np.zeros(LANES, bool)
    while not ended.all():
        observations, _, terminated, truncated, info = envs.step(policy.act(observations))
        succeeded |= info["success"] & ~ended
        ended |= terminated | truncated
    assert succeeded.mean() >= 0.9
