"""The hopper: physics written again, its falls, its hops and its starts."""

import math

import gymnasium as gym
import jax
import numpy as np
import pytest
from functional_checks import begin_lanes, vector_of
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from integ_gym.envs import functional

HOPPER = "IntegHopper-v0"


def _hopped(p, state, controls, period):
    """State, work and losses by SciPy, in the Cartesian coordinates of two bodies; with events.

    The foot is a body of its own: the leg pulls at it, and the torque pushes it across the leg.
    """
    torque, force = controls
    x, x_dot, z, z_dot, theta, turning, hip, hip_dot, leg, leg_dot = state
    angle, swing = hip - theta, hip_dot - turning
    out, across = (np.array(a) for a in _axes(angle))
    foot, speed = [x, z] + leg * out, [x_dot, z_dot] + leg_dot * out + leg * swing * across
    start = [x, z, *foot, theta, hip, x_dot, z_dot, *speed, turning, *(0.0,) * 4]

    def parts(y):
        away, speed = y[2:4] - y[0:2], y[8:10] - y[6:8]
        length = math.hypot(*away)
        out = away / length
        across = np.array([-out[1], out[0]])
        return length, out, across, speed @ out, speed @ across / length

    def ground(y):
        depth = max(-y[3], 0.0)
        push = p.ground_stiffness * depth * max(1.0 - p.ground_damping * y[9], 0.0)
        smooth = math.sqrt(y[8] ** 2 + p.friction_speed**2)
        return -p.ground_friction * push * y[8] / smooth, push, p.ground_stiffness * depth

    def rates(_, y):
        length, out, across, stretching, swinging = parts(y)
        along = force - p.leg_stiffness * (length - p.leg_length) - p.damping * stretching
        on_foot = along * out + torque / length * across
        rub, push, elastic = ground(y)
        foot = (on_foot + np.array([rub, push])) / p.foot_mass - [0.0, p.gravity]
        torso = -on_foot / p.mass - [0.0, p.gravity]
        slipped, pressed = -rub * y[8], -(push - elastic) * y[9]
        work = torque * (swinging + y[10]) + force * stretching
        return [*y[6:10], y[10], swinging + y[10], *torso, *foot, torque / p.inertia,
                work, p.damping * stretching**2, slipped + pressed, slipped]  # fmt: skip

    def lands(_, y):
        return y[3]

    def slides(_, y):
        return y[8]

    y, t, events = np.array(start), 0.0, (lands, slides)
    lands.terminal = slides.terminal = True
    while t < period:
        solved = solve_ivp(rates, (t, period), y, "DOP853", rtol=1e-12, atol=1e-12, events=events)
        t, y = solved.t[-1], solved.y[:, -1]
        if t < period:
            step = min(1e-9, period - t)
            y, t = y + step * np.array(rates(t, y)), t + step
    length, _, _, stretching, swinging = parts(y)
    end = [y[0], y[6], y[1], y[7], y[4], y[10], y[5], swinging + y[10], length, stretching]
    return np.array(end), y[11:]


def _axes(angle):
    return (math.sin(angle), -math.cos(angle)), (math.cos(angle), math.sin(angle))


def test_the_truth_is_the_motion_written_again():
    """State, work and losses after every decision of the first hops, touch-downs located."""
    env = gym.make(HOPPER, integrator="reference", dt=0.02).unwrapped
    env.reset(seed=2)
    env.action_space.seed(2)
    touched = 0
    for _ in range(30):
        before, action = env.state, 0.2 * env.action_space.sample()
        *_, info = env.step(action)
        expected, (work, lost, in_contact, slipped) = _hopped(
            env.setup.plant, before, action.astype(float), 0.02
        )
        np.testing.assert_allclose(env.state, expected, rtol=0, atol=1e-10)
        assert info["actuator_work"] == pytest.approx(work, abs=1e-10)
        assert info["dissipated"] == pytest.approx(lost, abs=1e-10)
        assert info["contact_loss"] == pytest.approx(in_contact, abs=1e-10)
        assert info["slip_loss"] == pytest.approx(slipped, abs=1e-10)
        assert abs(info["energy_residual"]) < 1e-10
        touched += info["foot_normal_force"] > 0.0
    assert 10 <= touched <= 25


@given(
    hip=st.floats(-1.0, 1.0), spin=st.floats(-5.0, 5.0), leg_dot=st.floats(-1.0, 1.0),
    torque=st.floats(-20.0, 20.0), force=st.floats(-150.0, 150.0),
    integrator=st.sampled_from(["rk4", "reference"]),
)  # fmt: skip
@settings(max_examples=10, deadline=None)
def test_in_the_air_controls_move_neither_the_centre_of_mass_nor_the_momentum(
    hip, spin, leg_dot, torque, force, integrator
):
    """It falls freely, and turns about its centre of mass with the momentum that it has."""
    env = gym.make(HOPPER, integrator=integrator, dt=0.002, control_period=0.02).unwrapped
    env.reset(options={"state": (0, 1, 2, 0.5, 0.1, 0.3, hip, spin, 0.5, leg_dot)})
    before = _as_a_whole(env)
    for _ in range(5):
        env.step(np.array([torque, force]))
    centre, speed, spin = _as_a_whole(env)
    assert centre == pytest.approx(before[0] + 0.1 * before[1] - [0.0, 0.04905], abs=1e-4)
    assert speed == pytest.approx(before[1] - [0.0, 0.981], abs=1e-3)
    assert spin == pytest.approx(before[2], abs=1e-3)


def _as_a_whole(env):
    """Centre of mass, its velocity, and angular momentum about it, positive as the pitch."""
    p, (x, x_dot, z, z_dot, theta, turning, hip, hip_dot, leg, leg_dot) = env.setup.plant, env.state
    out, across = (np.array(a) for a in _axes(hip - theta))
    share = p.foot_mass / (p.mass + p.foot_mass)
    speed = leg_dot * out + leg * (hip_dot - turning) * across
    swing = share * p.mass * leg**2 * (hip_dot - turning)
    return (
        np.array([x, z]) + share * leg * out, np.array([x_dot, z_dot]) + share * speed,
        p.inertia * turning - swing,
    )  # fmt: skip


@given(seed=st.integers(0, 1000), integrator=st.sampled_from(["rk4", "symplectic_euler"]))
@settings(max_examples=10, deadline=None)
def test_the_ground_pushes_and_rubs_and_takes_energy(seed, integrator):
    env = gym.make(HOPPER, integrator=integrator, dt=0.001, control_period=0.02)
    env.reset(seed=seed)
    env.action_space.seed(seed)
    ended = touched = False
    while not ended:
        *_, ended, _, info = env.step(0.2 * env.action_space.sample())
        push, rub = info["foot_normal_force"], info["foot_tangential_force"]
        assert abs(rub) <= 0.8 * push
        assert rub * info["foot_slip_speed"] <= 0.0
        assert 0.0 <= info["slip_loss"] <= info["contact_loss"]
        assert info["contact_force"] >= push
        assert info["foot_penetration"] == info["penetration"] >= 0.0
        touched |= push > 0.0
    assert touched


def test_falling_ends_the_episode_and_far_and_upright_at_speed_is_the_goal():
    env = gym.make(HOPPER)
    for state, fallen, there in (
        ((6.0, 1.0, 0.6, 0, 0.1, 0, 0, 0, 0.5, 0), False, True),
        ((4.0, 1.0, 0.6, 0, 0.1, 0, 0, 0, 0.5, 0), False, False),
        ((6.0, 0.5, 0.6, 0, 0.1, 0, 0, 0, 0.5, 0), False, False),
        ((6.0, 1.0, 0.6, 0, 0.35, 0, 0, 0, 0.5, 0), False, False),
        ((0.0, 1.0, 0.6, 0, 1.05, 0, 0, 0, 0.5, 0), True, False),
        ((0.0, 1.0, 0.29, 0, 0.0, 0, 0, 0, 0.25, 0), True, False),
    ):
        env.reset(options={"state": state})
        _, reward, terminated, _, info = env.step(np.zeros(2, dtype=np.float32))
        assert (terminated, info["goal_since"] >= 0.0) == (fallen, there)
        assert 0.0 < reward <= 0.5


def test_starts_are_dropped():
    env, starts = gym.make(HOPPER), []
    for seed in range(60):
        env.reset(seed=seed)
        starts.append(env.unwrapped.state)
    low, high = np.min(starts, axis=0), np.max(starts, axis=0)
    least = np.array([0, 0, 0.55, 0, -0.1, -0.3, -0.1, 0, 0.5, 0])
    most = np.array([0, 1, 0.65, 0, 0.1, 0.3, 0.1, 0, 0.5, 0])
    assert (least <= low).all()
    assert (high <= most).all()
    assert (high - low >= 0.9 * (most - least)).all()


@pytest.mark.parametrize("vector", [False, True])
def test_a_solution_whose_residual_is_beyond_all_floats_is_a_divergence(vector):
    """A leg of no length moves so slowly that the residual, relative to its speed, overflows."""
    arguments = {
        "integrator": "implicit_euler", "dt": 1.0, "mass": 1.0, "inertia": 1.0, "foot_mass": 1.0,
        "leg_length": 1.0, "leg_stiffness": 67.0, "damping": 1.0, "gravity": 1.0,
        "ground_stiffness": 667.0, "ground_damping": 1.0, "ground_friction": 1.0,
        "friction_speed": 1.0,
    }  # fmt: skip
    state, action = np.array([0.0] * 9 + [1e-200]), np.array([1.0, 0.0])
    if vector:
        env = gym.make_vec(HOPPER, num_envs=1, **arguments)
        state, action = state[None], action[None]
    else:
        env = gym.make(HOPPER, disable_env_checker=True, **arguments)
    env.reset(options={"state": state})
    _, reward, terminated, _, info = env.step(action)
    assert np.all(terminated)
    assert np.all(np.asarray(info["solver_status"]) == "diverged")
    assert np.isfinite(reward).all()
    assert np.isfinite(info["solver_residual"]).all()


@pytest.mark.parametrize("integrator", ["rk4", "symplectic_euler"])
def test_all_forms_agree_through_a_touch_down(integrator):
    """Single, vector, compiled and JAX: in the air, on landing and while the foot slides.

    Rounding grows in a contact as stiff as this: worlds whose sums have another order part by some
    1e-12 in one stance.
    """
    lanes, given = 4, {"integrator": integrator, "dt": 0.001, "control_period": 0.02}
    plain, compiled = (vector_of(HOPPER, lanes, compiled=c, **given) for c in (False, True))
    singles = [gym.make(HOPPER, **given) for _ in range(lanes)]
    rng, touched = np.random.default_rng(0), np.zeros(lanes, dtype=bool)
    with jax.enable_x64(True):
        env = functional.make(HOPPER, dtype="float64", **given)
        advance, state = jax.jit(env.transition), env.initial(jax.random.key(0), None, (lanes,))
        begin_lanes(plain, state, np.ones(lanes, dtype=bool))
        starts = plain.state
        compiled.reset(options={"state": starts})
        for single, start in zip(singles, starts, strict=True):
            single.reset(options={"state": start})
        for count in range(14):
            action = (0.1 * rng.uniform([-20.0, -150.0], [20.0, 150.0], (lanes, 2))).astype("f4")
            seen, *_, told = plain.step(action)
            again, *_, info = compiled.step(action)
            each = [single.step(own) for single, own in zip(singles, action, strict=True)]
            state = advance(state, action, jax.random.key(count), env.default_params)
            in_jax = env.state_info(state)
            np.testing.assert_array_equal(again, seen)
            np.testing.assert_array_equal(compiled.state, plain.state)
            np.testing.assert_allclose([x[0] for x in each], seen, rtol=1e-12, atol=1e-12)
            np.testing.assert_allclose(env.observation(state), seen, rtol=1e-10, atol=1e-10)
            for name in set(in_jax) - {"solver_status"}:
                np.testing.assert_array_equal(info[name], told[name], err_msg=name)
                alone = [x[4][name] for x in each]
                np.testing.assert_allclose(alone, told[name], 1e-12, 1e-12, err_msg=name)
                np.testing.assert_allclose(in_jax[name], told[name], 1e-9, 1e-9, err_msg=name)
            touched |= told["foot_slip_loss"] > 0.0
    assert touched.all()
