"""Position servos, where they are computed, and what they are held against."""

import pickle
from importlib import import_module

import gymnasium as gym
import numpy as np
import pytest
from engine_cases import needs
from functional_checks import compare
from recording import CONTEXT, made, play
from scipy.integrate import solve_ivp

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.numerics import goal_energy
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.registries import INTEGRATORS
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.baselines import has_handmade, possible_baselines

STIFFNESS, DAMPING, TARGETS = 40.0, 2.0, (0.4, -0.6, 0.2)
SERVO = {
    "actuator": "position", "servo_stiffness": STIFFNESS, "servo_damping": DAMPING,
    "max_torque": 100.0, "control_period": 0.1, "dt": 0.005, "integrator": "rk4",
}  # fmt: skip
MODES = ({}, {"servo": "step"}, {"servo": "period", "servo_period": 0.01})
INERTIA, WEIGHT = 1.0 / 3.0, 5.0
"""Of the pendulum of 1 kg and 1 m under 10 m/s², kg m² and N m."""


def _driven(**arguments):
    """State and `info` after each of the targets."""
    env = gym.make("IntegPendulum-v0", **{**SERVO, **arguments})
    env.reset(options={"state": (0.3, 0.0)})
    for target in TARGETS:
        info = env.step(np.array([target], dtype=np.float64))[4]
        yield env.unwrapped.state, info


def test_a_continuous_servo_is_the_closed_loop_that_scipy_solves():
    """Effort, reward of its mean square, work and energy by equations written again."""
    start, time = np.array([0.3, 0.0, 0.0, 0.0]), SERVO["control_period"]
    found = list(_driven(integrator="reference"))
    for target, (state, info) in zip(TARGETS, found, strict=True):

        def slopes(_, y, target=target):
            effort = STIFFNESS * (target - y[0]) - DAMPING * y[1]
            acceleration = (WEIGHT * np.sin(y[0]) + effort) / INERTIA
            return y[1], acceleration, effort * y[1], effort * effort

        end = solve_ivp(slopes, (0.0, time), start, "DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
        np.testing.assert_allclose(state, end[:2], rtol=0, atol=1e-9)
        effort = STIFFNESS * (target - end[0]) - DAMPING * end[1]
        assert info["theta_effort"] == pytest.approx(effort, abs=1e-7)
        assert info["actuator_work"] == pytest.approx(end[2] - start[2], abs=1e-8)
        assert (info["control"], info["energy_residual"]) == (target, pytest.approx(0, abs=1e-11))
        start = end


@pytest.mark.parametrize(
    "env_id",
    ["IntegPendulum-v0", "IntegElasticPendulum-v0", "IntegAcrobotSwingUp-v0", "IntegReacher-v0"],
)
def test_slopes_include_a_continuous_servo(env_id):
    """Derivatives that implicit integrators use equal differences of the accelerations."""
    system = environment_setup(env_id, {"actuator": "position", "servo": "continuous"}).system
    n, rng, small = len(system.plant.coordinates), np.random.default_rng(0), 1e-6
    controls = tuple(rng.uniform(-0.5, 0.5, len(system.plant.controls)))

    def accelerations(y):
        return np.array(system.rates(SCALAR, tuple(y[:n]), tuple(y[n:]), controls)[0])

    for _ in range(20):
        y, shifts = rng.uniform(-0.3, 0.3, 2 * n), small * np.eye(2 * n)
        wanted = [(accelerations(y + s) - accelerations(y - s)) / (2.0 * small) for s in shifts]
        found = np.hstack(system.slopes(SCALAR, tuple(y[:n]), tuple(y[n:]), controls))
        np.testing.assert_allclose(found, np.transpose(wanted), rtol=1e-5, atol=1e-4)


def test_an_effort_beyond_the_motors_limit_is_cut():
    limit = 1.5
    told = [info for _, info in _driven(max_torque=limit, servo="step")]
    assert max(abs(info["theta_effort"]) for info in told) == limit
    assert [info["saturated"] for info in told] == [
        abs(info["theta_effort"]) == limit for info in told
    ]


@pytest.mark.parametrize(("servo", "period"), [("step", 0.005), ("period", 0.02)])
@pytest.mark.parametrize("integrator", ["explicit_euler", "implicit_midpoint", "rk4"])
def test_a_sampled_servo_is_a_motor_that_is_told_as_often(servo, period, integrator):
    """To the last bit: the same efforts, decided by hand."""
    given = {"servo_period": period} if servo == "period" else {}
    found = list(_driven(servo=servo, integrator=integrator, **given))
    motor = gym.make(
        "IntegPendulum-v0", dt=0.005, control_period=period, integrator=integrator, max_torque=100.0
    )
    motor.reset(options={"state": (0.3, 0.0)})
    for target, (state, info) in zip(TARGETS, found, strict=True):
        for _ in range(round(SERVO["control_period"] / period)):
            theta, speed = motor.unwrapped.state
            effort = STIFFNESS * (target - theta) - DAMPING * speed
            told = motor.step(np.array([effort]))[4]
        assert (state == motor.unwrapped.state).all()
        assert info["theta_effort"] == told["control"]


@pytest.mark.parametrize(("ratio", "stable"), [(1.8, True), (2.2, False)])
def test_a_servo_that_is_held_over_a_step_is_stable_up_to_its_limit(ratio, stable):
    """Damping alone: each step multiplies the speed by 1 − k_d h / I; continuous ones decay."""
    damping = ratio * INERTIA / SERVO["dt"]
    given = {"servo_stiffness": 1e-9, "servo_damping": damping, "gravity": 0.0, "max_torque": 1e6}
    for servo, integrator, holds in (
        ("step", "rk4", stable),
        ("step", "implicit_midpoint", stable),
        ("continuous", "implicit_midpoint", True),
        ("continuous", "reference", True),
    ):
        env = gym.make(
            "IntegPendulum-v0", **{**SERVO, **given, "servo": servo, "integrator": integrator}
        )
        env.reset(options={"state": (0.0, 1.0)})
        env.step(np.zeros(1))
        assert (abs(env.unwrapped.state[1]) < 1.0) == holds, (servo, integrator)


@pytest.mark.parametrize(
    "servo", [{}, {"servo": "step"}, {"servo": "period", "servo_period": 0.01}]
)
@pytest.mark.parametrize(
    "env_id", ["IntegPendulum-v0", "IntegCartPoleSwingUp-v0", "IntegReacher-v0"]
)
def test_all_forms_are_the_same(env_id, servo):
    given = {
        "actuator": "position", "integrator": "implicit_midpoint", "dt": 0.005,
        "control_period": 0.05, "target_limit": 1.0, **servo,
    }  # fmt: skip
    compare(env_id, given, steps=8, lanes=3)
    runs = []
    for compiled in (False, True):
        env = gym.make_vec(env_id, num_envs=3, compiled=compiled, **given)
        env.reset(seed=1)
        env.action_space.seed(1)
        runs.append([env.step(env.action_space.sample()) for _ in range(60)])
    for (*one, told), (*other, known) in zip(*runs, strict=True):
        for a, b in zip(one, other, strict=True):
            np.testing.assert_array_equal(a, b)
        for name in known:
            np.testing.assert_array_equal(told[name], known[name])


@pytest.mark.parametrize("integrator", INTEGRATORS.names())
def test_records_tell_efforts_and_replay_to_the_last_bit(integrator, tmp_path):
    env = made(tmp_path, CONTEXT, "IntegPendulum-v0", **{**SERVO, "integrator": integrator})
    play(env, range(2))
    env.close()
    store = EvidenceStore(tmp_path)
    for record in store.records():
        assert record.trace["theta_effort"].any()
        assert (np.abs(record.trace["theta_target_commanded"]) <= np.float32(np.pi)).all()
    assert store.verify() == []


def test_what_cannot_be_is_refused():
    pendulum = {**SERVO, "servo": "period"}
    with pytest.raises(ValueError, match="`servo_period` is for"):
        environment_setup("IntegPendulum-v0", pendulum)
    with pytest.raises(ValueError, match="whole multiple"):
        environment_setup("IntegPendulum-v0", {**pendulum, "servo_period": 0.007})
    with pytest.raises(ValueError, match="`servo_period` is for"):
        environment_setup("IntegPendulum-v0", {**SERVO, "servo_period": 0.01})
    with pytest.raises(ValueError, match="needs a `Box` of targets"):
        environment_setup("IntegCartPole-v0", {"actuator": "position"})
    with pytest.raises(ValueError, match="unknown actuator 'muscle'"):
        environment_setup("IntegPendulum-v0", {"actuator": "muscle"})
    with pytest.raises(TypeError, match="give `actuator`='position'"):
        environment_setup("IntegPendulum-v0", {"servo_stiffness": 3.0})


def test_a_setup_with_a_servo_can_be_sent_to_another_process():
    setup = environment_setup("IntegPendulum-v0", SERVO)
    assert pickle.loads(pickle.dumps(setup)).arguments() == setup.arguments()
    assert type(setup.task).__doc__ == environment_setup("IntegPendulum-v0", {}).task.__doc__


@pytest.mark.parametrize("engine", ["casadi", "mujoco", "pinocchio"])
def test_other_engines_take_sampled_servos(engine):
    """The same motion as our own map's, to rounding; continuous ones, or a sentence."""
    needs(engine)
    own = {"casadi": "rk", "mujoco": "Euler", "pinocchio": "rk4"}[engine]
    known = {"Euler": "symplectic_euler"}.get(own, "rk4")
    for servo in MODES:
        given = {"engine": engine, "integrator": own, **servo}
        if engine == "mujoco" and not servo:
            with pytest.raises(ValueError, match="holds forces over a step"):
                environment_setup("IntegPendulum-v0", {**SERVO, **given})
            continue
        pairs = zip(_driven(**given), _driven(integrator=known, **servo), strict=True)
        for (state, info), (expected, told) in pairs:
            np.testing.assert_allclose(state, expected, rtol=0, atol=1e-9)
            assert info["theta_effort"] == pytest.approx(told["theta_effort"], abs=1e-7)


def test_what_gives_efforts_is_left_out():
    setup = environment_setup("IntegPendulum-v0", {**SERVO, "start": "hanging"})
    assert not has_handmade(setup)
    assert possible_baselines(setup) == ("random", "zero")
    assert goal_energy(setup) is None


@pytest.mark.parametrize(
    ("integrator", "own"),
    [
        ("Euler", "symplectic_euler"),
        ("implicitfast", "integ_gym.envs.engines.maps:SymplecticEulerImplicitVelocity"),
        ("RK4", "rk4"),
    ],
)
def test_mujocos_own_servo_is_a_continuous_one(integrator, own):
    """Its position actuator, on the same arm without gravity, under the map of its integrator."""
    needs("mujoco")
    mujoco = import_module("mujoco")
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="0.005" integrator="{integrator}" gravity="0 0 0"/><worldbody>'
        '<body><joint name="j" axis="0 1 0"/>'
        f'<inertial pos="0 0 0" mass="1" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/></body>'
        f'</worldbody><actuator><position joint="j" kp="{STIFFNESS}" kv="{DAMPING}"/></actuator>'
        "</mujoco>"
    )
    data = mujoco.MjData(model)
    data.qpos[0] = 0.3
    found = list(_driven(integrator=own, gravity=0.0))
    for target, (state, _) in zip(TARGETS, found, strict=True):
        data.ctrl[0] = target
        mujoco.mj_step(model, data, round(SERVO["control_period"] / SERVO["dt"]))
        np.testing.assert_allclose((data.qpos[0], data.qvel[0]), state, rtol=0, atol=1e-12)
