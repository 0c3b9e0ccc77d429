"""The quadrotor: physics written again, its lag, its room and its starts."""

from __future__ import annotations

import math

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.registries import INTEGRATORS

QUADROTOR = "IntegQuadrotor-v0"
PERIOD = {"dt": 0.02, "control_period": 0.02}


def _flown(plant, state, thrusts, period):
    """State, work and loss by SciPy, equations written again; state in the environment's order."""

    def rates(_, y):
        x_dot, z_dot, theta, turning, left, right = y[[1, 3, 4, 5, 7, 9]]
        if plant.motor_time_constant is None:
            (left, right), lags = thrusts, (0.0, 0.0)
        else:
            lags = [
                (u - y[k]) / plant.motor_time_constant for u, k in zip(thrusts, (7, 9), strict=True)
            ]
        along_x, along_z = (left + right) * math.sin(theta), (left + right) * math.cos(theta)
        torque, drag = plant.arm * (left - right), plant.damping
        return [
            x_dot, (along_x - drag * x_dot) / plant.mass,
            z_dot, (along_z - drag * z_dot) / plant.mass - plant.gravity,
            turning, torque / plant.inertia,
            y[7], lags[0], y[9], lags[1],
            along_x * x_dot + along_z * z_dot + torque * turning,
            drag * (x_dot**2 + z_dot**2),
        ]  # fmt: skip

    start = (*state, 0.0, 0.0)
    end = solve_ivp(rates, (0.0, period), start, "DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    return end[:10], end[10], end[11]


@pytest.mark.parametrize("lag", [0.05, 0.004, None])
def test_the_truth_is_the_motion_written_again(lag):
    """State, work and loss after every decision, from the same start, to 1e-10."""
    env = gym.make(QUADROTOR, integrator="reference", motor_time_constant=lag, **PERIOD).unwrapped
    env.action_space.seed(0)
    env.reset(options={"state": (0.5, -1, 0.3, 2, 0.4, 0.5, 0, 2, 0, 5)})
    for _ in range(30):
        before, action = env.state, env.action_space.sample()
        *_, info = env.step(action)
        expected, work, lost = _flown(env.setup.plant, before, action.astype(float), 0.02)
        np.testing.assert_allclose(env.state, expected, rtol=0, atol=1e-10)
        assert info["actuator_work"] == pytest.approx(work, abs=1e-10)
        assert info["dissipated"] == pytest.approx(lost, abs=1e-10)
        assert abs(info["energy_residual"]) < 1e-12


@given(
    thrust=st.floats(0.0, 6.0), lag=st.floats(0.01, 0.5), first=st.floats(0.0, 6.0),
    integrator=st.sampled_from(["rk4", "implicit_midpoint", "reference"]),
)  # fmt: skip
@settings(max_examples=20, deadline=None)
def test_thrusts_lag_and_equal_ones_do_not_turn(thrust, lag, first, integrator):
    env = gym.make(
        QUADROTOR, integrator=integrator, dt=0.001, control_period=0.02, motor_time_constant=lag,
    ).unwrapped  # fmt: skip
    env.reset(options={"state": (0, 0, 0, 0, 0, 0, 0, first, 0, first)})
    for _ in range(5):
        env.step(np.array([thrust, thrust]))
    left = thrust + (first - thrust) * math.exp(-0.1 / lag)
    assert env.state[[7, 9]] == pytest.approx([left, left], abs=1e-4)
    assert np.abs(env.state[[0, 1, 4, 5]]).max() == 0.0


def test_energy_is_what_work_drag_and_the_start_make_of_it():
    """To the order of the integrator."""
    residuals = {}
    for steps in (1, 2, 4):
        env = gym.make(QUADROTOR, integrator="rk4", dt=0.04 / steps, control_period=0.04)
        env.reset(seed=3)
        env.action_space.seed(3)
        residuals[steps] = sum(
            abs(env.step(env.action_space.sample())[-1]["energy_residual"]) for _ in range(10)
        )
    assert 13.0 < residuals[1] / residuals[2] < 40.0
    assert 13.0 < residuals[2] / residuals[4] < 40.0


def test_leaving_the_room_ends_the_episode_and_pays_nothing():
    env = gym.make(QUADROTOR)
    env.reset(options={"state": (0, 0, -2.9, -1, 0, 0, 0, 0, 0, 0)})
    *_, terminated, truncated, info = env.step(np.zeros(2, dtype=np.float32))
    assert not terminated
    while not terminated:
        _, reward, terminated, truncated, info = env.step(np.zeros(2, dtype=np.float32))
        assert 0.0 <= reward <= 1.0
    assert env.unwrapped.state[2] < -3.0
    assert not truncated
    assert not info["success"]
    setup = environment_setup(QUADROTOR, {})
    assert setup.task.worst_return(None, 100, 0.02, 1e3) == 0.0


def test_servos_on_its_rotors_are_refused():
    with pytest.raises(ValueError, match="puts servos on driven coordinates"):
        gym.make(QUADROTOR, actuator="position")


def test_starts_are_thrown_with_idle_rotors():
    starts = []
    envs = gym.make(QUADROTOR)
    for seed in range(60):
        envs.reset(seed=seed)
        starts.append(envs.unwrapped.state)
    most = np.abs(starts).max(axis=0)
    assert (most <= [1.5, 1, 1.5, 1, 0.5, 1, 0, 0, 0, 0]).all()
    assert (most[:6] > [1.3, 0.9, 1.3, 0.9, 0.45, 0.9]).all()
    envs.reset(seed=0, options={"throw": 0.1})
    assert np.abs(envs.unwrapped.state[[1, 3, 5]]).max() <= 0.1
    with pytest.raises(ValueError, match="reset option `throw` must be finite"):
        envs.reset(seed=0, options={"throw": -1.0})


@pytest.mark.parametrize("task", [{}, {"way_point_period": 0.5}])
@pytest.mark.parametrize("integrator", ["rk4", "implicit_midpoint"])
def test_one_lane_of_many_is_the_single_environment_compiled_or_not(integrator, task):
    arguments = {"integrator": integrator, "dt": 0.01, "control_period": 0.02, **task}
    plain = gym.make_vec(QUADROTOR, 3, **arguments)
    compiled = gym.make_vec(QUADROTOR, 3, compiled=True, **arguments)
    single = gym.make(QUADROTOR, **arguments)
    plain.action_space.seed(0)
    for made in (plain, compiled, single):
        made.reset(seed=5)
    for _ in range(70):
        actions = plain.action_space.sample()
        of_many, of_compiled, of_one = plain.step(actions), compiled.step(actions), None
        np.testing.assert_array_equal(of_many[0], of_compiled[0])
        if not (of_many[2][0] or of_many[3][0]):
            of_one = single.step(actions[0])
            np.testing.assert_array_equal(of_many[0][0], of_one[0])
            for name in ("left_thrust_commanded", "right_thrust_applied", "actuator_work"):
                assert of_many[4][name][0] == of_compiled[4][name][0] == of_one[4][name]
        else:
            break


@pytest.mark.parametrize("integrator", INTEGRATORS.names())
def test_way_points_are_the_corners_in_turn_and_move_nothing(integrator):
    """Seen from each, for as long as it is asked for; the flight is that of the hovering task."""
    given = {"integrator": integrator, "dt": 0.02, "duration": 4.0}
    hovering, guided = (
        gym.make(QUADROTOR, way_point_period=period, **given).unwrapped for period in (None, 0.5)
    )
    start = (0.2, 0, -0.1, 0, 0.1, 0, 0, 3, 0, 3)
    hovering.reset(options={"state": start})
    guided.reset(options={"state": (*start, 0.01, math.pi)})
    corners = [(0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (0.5, -0.5)]
    for k in range(1, 80):
        thrusts = np.array([3.2, 3.2 + 0.02 * math.sin(k)])
        _, _, _, _, of_one = hovering.step(thrusts)
        seen, *_, of_other = guided.step(thrusts)
        np.testing.assert_allclose(guided.state[:10], hovering.state, rtol=0, atol=1e-12)
        assert guided.state[10:] == pytest.approx((0.01 + 0.02 * k * math.pi, math.pi), abs=1e-12)
        x, z = corners[int((0.01 + 0.02 * k * math.pi) // (0.5 * math.pi)) % 4]
        assert seen[[0, 2]] == pytest.approx(guided.state[[0, 2]] - (x, z), abs=1e-6)
        assert of_one["energy_residual"] == pytest.approx(of_other["energy_residual"], abs=1e-12)


def test_hovering_in_the_middle_of_way_points_is_no_success():
    """The first half of each way-point's time is to fly there, the second is not."""
    env = gym.make(QUADROTOR, way_point_period=1.0, duration=4.0, integrator="reference").unwrapped
    level = np.full(2, 0.5 * env.setup.plant.weight)
    for corner, reached in (((0.5, 0.5), True), ((0.0, 0.0), False)):
        x, z = corner
        phase = 0.01 + 0.25 * math.pi  # of the second half
        env.reset(
            options={"state": (x, 0, z, 0, 0, 0, 0, level[0], 0, level[0], phase, 0.5 * math.pi)}
        )
        *_, info = env.step(level)
        assert (info["goal_since"] >= 0.0) is reached
    for _ in range(199):
        *_, truncated, info = env.step(level)
    assert truncated
    assert not info["success"]
    assert env.setup.task.goal_stay == 2.0
