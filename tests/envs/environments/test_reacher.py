"""The reacher: physics written again, its servos' limits, its marker, and its engines."""

import math

import gymnasium as gym
import numpy as np
import pytest
from engine_cases import FIRST, lighter, native_name, needs
from scipy.integrate import solve_ivp

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.registries import ENGINES, INTEGRATORS

REACHER = "IntegReacher-v0"
START = (0.3, 1.0, 1.2, -2.0, 0.5, 2.1)
LIMIT, STIFFNESS, DAMPING = 10.0, 60.0, 4.0


def _moved(state, targets, period, gravity):
    """State and work by SciPy: equations written again, with an event where an effort saturates."""
    length, centre = 0.5, 0.25

    def wanted(y, k):
        return STIFFNESS * (targets[k] - y[2 * k]) - DAMPING * y[2 * k + 1]

    def rates(_, y):
        one, w_1, two, w_2 = y[:4]
        efforts = [min(max(wanted(y, k), -LIMIT), LIMIT) for k in (0, 1)]
        inner = 0.0208 + length**2 + centre**2 + 2 * length * centre * math.cos(two)
        outer = 0.0208 + centre**2
        mixed = outer + length * centre * math.cos(two)
        mass = [[inner + centre**2 + 0.0208, mixed], [mixed, outer]]
        whirl = length * centre * math.sin(two)
        far = centre * gravity * math.sin(one + two)
        forces = [
            efforts[0] + whirl * w_2 * (2 * w_1 + w_2) - 0.75 * gravity * math.sin(one) - far,
            efforts[1] - whirl * w_1**2 - far,
        ]
        a_1, a_2 = np.linalg.solve(mass, forces)
        return [w_1, a_1, w_2, a_2, y[5], 0.0, efforts[0] * w_1 + efforts[1] * w_2]

    def reaching(k, bound):
        event = lambda _, y: wanted(y, k) - bound  # noqa: E731
        event.terminal = True
        return event

    events = [reaching(k, bound) for k in (0, 1) for bound in (-LIMIT, LIMIT)]
    y, time, met = np.array([*state, 0.0]), 0.0, 0
    while time < period:
        found = solve_ivp(rates, (time, period), y, "DOP853", events=events, rtol=1e-13, atol=1e-13)
        y, met = found.y[:, -1], met + (found.status == 1)
        time = found.t[-1]
        if found.status == 1:  # past the event, by a step too short to matter
            y, time = y + 1e-13 * np.array(rates(time, y)), time + 1e-13
    return y[:6], y[6], met


@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_the_truth_is_the_motion_written_again(gravity):
    """State and work after every decision, from the same start, through saturation, to 1e-10."""
    env = gym.make(REACHER, integrator="reference", dt=0.04, gravity=gravity).unwrapped
    env.action_space.seed(0)
    env.reset(options={"state": START})
    saturations = 0
    for _ in range(25):
        before, action = env.state, 0.5 * env.action_space.sample()
        *_, info = env.step(action)
        expected, work, met = _moved(before, action.astype(float), 0.04, gravity)
        saturations += met
        np.testing.assert_allclose(env.state, expected, rtol=0, atol=1e-10)
        assert info["actuator_work"] == pytest.approx(work, abs=1e-9)
        assert abs(info["energy_residual"]) < 1e-10
    assert saturations > 10


@pytest.mark.parametrize("integrator", INTEGRATORS.names())
def test_the_marker_is_exact_in_every_integrator(integrator):
    env = gym.make(REACHER, integrator=integrator, dt=0.02).unwrapped
    env.reset(options={"state": START})
    for _ in range(50):
        observation, *_ = env.step(np.array([0.1, 1.5]))
    phase = 0.5 + 2.1
    assert env.state[4:] == pytest.approx([phase, 2.1], abs=1e-13)
    x, z, vx, vz = observation[6:]
    along, up = 0.25 * math.cos(phase), 0.25 * math.sin(phase)
    assert (x, z) == pytest.approx((along, up - 0.6), abs=1e-6)
    assert (vx, vz) == pytest.approx((-2.1 * up, 2.1 * along), abs=1e-6)


@pytest.mark.parametrize(("engine", "integrator"), lighter(FIRST))
@pytest.mark.parametrize("how", [{"servo": "step"}, {"actuator": "effort"}])
def test_engines_move_the_arm_and_the_marker_goes_on(engine, integrator, how):
    """By identity, samples and latency included."""
    needs(engine)
    given = {"dt": 0.004, "control_period": 0.02, "sensor_period": 0.012, "action_latency": 0.004}
    there = gym.make(REACHER, engine=engine, integrator=integrator, **given, **how).unwrapped
    own = native_name(ENGINES.load(engine).maps[integrator])
    here = gym.make(REACHER, integrator=own, **given, **how).unwrapped
    near = {64: 1e-11, 32: 2e-5}[there.setup.engine.width]
    for env in (there, here):
        env.reset(options={"state": START})
    for k in range(10):
        action = 2.0 * np.sin([k, 2.0 * k])
        found, expected = there.step(action), here.step(action)
        np.testing.assert_allclose(there.state, here.state, rtol=near, atol=near)
        np.testing.assert_allclose(found[0], expected[0], rtol=near, atol=max(near, 1e-6))
        assert found[4]["actuator_work"] == pytest.approx(expected[4]["actuator_work"], abs=near)


def test_efforts_are_said_where_targets_are_the_default():
    setup = environment_setup(REACHER, {"actuator": "effort"})
    assert setup.arguments()["actuator"] == "effort"
    again = environment_setup(REACHER, {n: setup.arguments()[n] for n in ("actuator", "dt")})
    assert [name for name, _ in again.plant.controls] == ["torque_1", "torque_2"]
    assert environment_setup(REACHER, {}).arguments()["actuator"] == "position"


def test_starts_are_bent_and_markers_go_at_any_rate():
    envs = gym.make_vec(REACHER, 60)
    envs.reset(seed=0)
    theta_1, _, theta_2, _, phase, rate = envs.unwrapped.state.T
    assert np.abs(theta_1).max() <= 0.5
    assert ((theta_2 >= 0.5) & (theta_2 <= 2.0)).all()
    assert phase.min() < -2.5 < 2.5 < phase.max()
    assert -math.pi <= rate.min() < -2.9 < 2.9 < rate.max() <= math.pi


@pytest.mark.parametrize("env_id", [REACHER, "IntegQuadrotor-v0"])
def test_a_clock_starts_at_the_rate_of_its_lane(env_id):
    name = "marker_period" if env_id == REACHER else "way_point_period"
    envs = gym.make_vec(env_id, 2, **{name: np.array([1.0, 2.0])})
    envs.reset(seed=3)
    rates = [gym.make(env_id, **{name: period}).unwrapped for period in (1.0, 2.0)]
    for lane, env in enumerate(rates):
        env.reset(seed=3 + lane)
        np.testing.assert_array_equal(envs.unwrapped.state[lane], env.state)
