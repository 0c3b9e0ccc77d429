"""Contract of the single environment: arguments, info, timing, fallback, success, divergence."""

from math import inf, nan, pi, remainder

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from motions import ALL, UNLIMITED
from pairing import pairs

import integ_gym
from integ_gym.envs.catalogue.pendulum import IntegPendulumEnv
from integ_gym.envs.engines.stepping import DIVERGENCE_SPEED
from integ_gym.envs.environment import environment_setup
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.tasks.interface import to_public_order

IDS = tuple(integ_gym.ENVIRONMENTS)
REACHER = "IntegReacher-v0"
STOCK_ADVICE = (
    "ignore:.*we recommend using a symmetric and normalized space:UserWarning",
    "ignore:.*Box observation space m(in|ax)imum value is -?infinity:UserWarning",
)


@pytest.mark.parametrize(
    ("integrator", "env_id", "late"), pairs(ALL, IDS, (False, True), strength=1)
)
@pytest.mark.filterwarnings(*STOCK_ADVICE)
def test_check_env(env_id, integrator, late):
    noisy = {"dt": 0.01, "control_period": 0.04, "action_latency": 0.01, "observation_noise": 0.1}
    env = gym.make(env_id, integrator=integrator, **(noisy if late else {})).unwrapped
    check_env(env, skip_render_check=True)


@pytest.mark.parametrize(
    ("arguments", "error", "fragments"),
    [
        ({"integrator": "rk5"}, ValueError, ["unknown integrator 'rk5'", "rk4", "reference"]),
        ({"integrator": "nowhere:Thing"}, ValueError, ["cannot load", "module:Class"]),
        ({"engine": "havok"}, ValueError, ["unknown engine", "native"]),
        ({"dt": 0.0}, ValueError, ["`dt`", "above 0", "got 0.0"]),
        ({"dt": -0.1}, ValueError, ["`dt`", "above 0"]),
        ({"dt": nan}, ValueError, ["`dt`", "finite", "nan"]),
        ({"dt": "fast"}, ValueError, ["`dt`", "finite number", "'fast'"]),
        ({"dt": 0.02, "control_period": 0.05}, ValueError, ["0.04 or 0.06"]),
        (
            {"dt": 0.05, "control_period": 0.02},
            ValueError,
            ["nearest valid: 0.05 or 0.1 s; or keep it, with `dt` 0.02 s"],
        ),
        ({"action_latency": 0.03}, ValueError, ["`action_latency`", "nearest valid"]),
        ({"sensor_period": 0.03}, ValueError, ["`sensor_period`", "nearest valid"]),
        ({"mass": -1.0}, ValueError, ["`mass`", "above 0"]),
        ({"masss": 1.0}, TypeError, ["unexpected keyword argument 'masss'", "Did you mean 'mass'"]),
        ({"fallback": "brake"}, ValueError, ["'hold'", "'zero'"]),
        ({"start": "sideways"}, ValueError, ["unknown start"]),
        ({"max_speed": 1e9}, ValueError, ["`max_speed`", "diverged"]),
        ({"mass_distribution": "cube"}, ValueError, ["'uniform'", "'point'"]),
        ({"render_mode": "ascii"}, ValueError, ["render_mode"]),
        ({"dt": 1e-320}, ValueError, ["`dt` must be 1e-30 or above"]),
        ({"dt": 1e-20}, ValueError, ["more than 1e+09"]),
        ({"mass": 10**400}, ValueError, ["`mass` must be a finite number above 0"]),
        ({"mass": 1e308}, ValueError, ["`mass` must be a finite number above 0"]),
        ({"duration": 1e20}, ValueError, ["more than 1e+09 control periods"]),
    ],
)
def test_impossible_arguments_name_the_remedy(arguments, error, fragments):
    defaults = {"dt": 0.02} if arguments.keys() & {"action_latency", "sensor_period"} else {}
    with pytest.raises(error) as caught:
        IntegPendulumEnv(**{**defaults, **arguments})
    for fragment in fragments:
        assert fragment in str(caught.value)


@pytest.mark.filterwarnings("ignore:.*the episode has terminated.*:UserWarning")
def test_a_diverged_motion_that_goes_on_pays_the_least_of_a_step():
    env = gym.make("IntegPendulum-v0", integrator="explicit_euler", dt=0.5)
    env.reset(options={"state": (1.5, 999.0)})
    while not (step := env.step([2.0]))[2]:
        pass
    assert step[1] < -1e6
    assert env.step([2.0])[1] == env.unwrapped.setup.task.worst_return(SCALAR, 1, 0.5, 1000.0)


def test_return_does_not_depend_on_the_control_period():
    returns = []
    for period in (0.05, 0.01, 0.002):
        env = gym.make("IntegPendulum-v0", integrator="reference", dt=period, duration=5.0)
        env.reset(options={"state": (pi, 1.0)})
        total, ended = 0.0, False
        while not ended:
            _, reward, _, ended, _ = env.step(np.array([0.5]))
            total += reward
        returns.append(total)
    assert returns[0] == pytest.approx(returns[2], rel=2e-3)
    assert returns[1] == pytest.approx(returns[2], rel=5e-4)


@pytest.mark.parametrize(("latency", "delay"), [(0.0, 0), (0.05, 5), (0.07, 7)])
def test_commands_act_after_the_latency(latency, delay):
    """Equal to stepping at dt with the command sequence shifted by the latency.

    The reward takes the mean square of the torque in force, as the documentation says.
    """
    rng = np.random.default_rng(0)
    commands = rng.uniform(-2, 2, 8)
    delayed = gym.make("IntegPendulum-v0", dt=0.01, control_period=0.05, action_latency=latency)
    fine = gym.make("IntegPendulum-v0", dt=0.01)
    for env in (delayed, fine):
        env.reset(options={"state": (2.0, 0.0)})
    shifted = np.concatenate([np.zeros(delay), np.repeat(commands, 5)])
    for index, command in enumerate(commands):
        theta, theta_dot = delayed.unwrapped.state
        _, reward, *_, info = delayed.step(np.array([command]))
        applied = shifted[5 * index : 5 * index + 5]
        for u in applied:
            fine.step(np.array([u]))
        angle = remainder(theta, 2.0 * pi)
        cost = angle**2 + 0.1 * theta_dot**2 + 0.001 * np.mean(applied**2)
        assert reward == pytest.approx(-cost, rel=1e-12)
        np.testing.assert_allclose(delayed.unwrapped.state, fine.unwrapped.state, rtol=1e-13)
        assert info["fallback_used"] == (5 * index < delay)
        assert info["control"] == shifted[5 * index + 4]
        assert info["commanded"] == command


@pytest.mark.parametrize("sensor", [2, 5, 7, 15])
def test_sensor_holds_its_last_sample(sensor):
    slow = gym.make("IntegPendulum-v0", dt=0.01, control_period=0.05, sensor_period=0.01 * sensor)
    fine = gym.make("IntegPendulum-v0", dt=0.01)
    for env in (slow, fine):
        env.reset(options={"state": (2.0, 0.3)})
    states = [fine.unwrapped.state]
    for k in range(1, 9):
        obs, *_, info = slow.step(np.array([0.7]))
        for _ in range(5):
            fine.step(np.array([0.7]))
            states.append(fine.unwrapped.state)
        last = 5 * k // sensor * sensor
        theta, theta_dot = states[last]
        np.testing.assert_allclose(obs, (np.cos(theta), np.sin(theta), theta_dot), rtol=1e-6)
        assert info["sensor_time"] == pytest.approx(0.01 * last)


def test_noise_is_drawn_once_per_sample_and_stays_in_the_space():
    env = gym.make(
        "IntegPendulum-v0", dt=0.05, sensor_period=0.15, observation_noise=3.0, max_speed=8.0
    )
    obs, _ = env.reset(seed=0)
    observed = [obs]
    for _ in range(9):
        obs, *_ = env.step(np.zeros(1))
        observed.append(obs)
        assert obs in env.observation_space
    groups = [np.array(observed[i : i + 3]) for i in (0, 3, 6)]
    for group in groups:
        assert (group == group[0]).all()
    assert not np.array_equal(groups[0][0], groups[1][0])


@pytest.mark.parametrize("bad", [nan, -inf])
@pytest.mark.parametrize(("fallback", "expected"), [("hold", 1.5), ("zero", 0.0)])
def test_fallback_acts_on_non_finite_actions(bad, fallback, expected):
    env = gym.make("IntegPendulum-v0", fallback=fallback)
    env.reset(seed=0)
    *_, info = env.step(np.array([1.5]))
    assert not info["fallback_used"]
    obs, reward, *_, info = env.step(np.array([bad]))
    assert info["fallback_used"]
    assert info["control"] == expected
    assert np.isfinite(obs).all()
    assert np.isfinite(reward)


def test_zero_fallback_is_zero_newton_for_discrete_actions():
    env = gym.make("IntegCartPole-v0", fallback="zero")
    env.reset(options={"state": (0.0, 0.0, 0.0, 0.0)})
    *_, info = env.step(nan)
    assert (info["control"], info["fallback_used"]) == (0.0, True)
    np.testing.assert_array_equal(env.unwrapped.state, np.zeros(4))
    for wrong in (2, -1, 0.5, "left", None):
        with pytest.raises(ValueError, match="must be one of 0, 1"):
            env.step(wrong)


def test_saturation_is_counted():
    for limit in (0.1, 0.8, 0.9, 1.0, 2.0):
        env = gym.make("IntegPendulum-v0", max_torque=limit)
        env.reset(seed=0)
        for action, saturated in ((3.0 * limit, True), (0.999 * limit, False)):
            *_, info = env.step(np.array([action]))
            assert info["control"] == pytest.approx(min(action, limit))
            assert info["saturated"] is saturated
        *_, info = env.step(env.action_space.high)
        assert info["saturated"] is True


def _swing(states_inside: list[bool]):
    """Run a short pendulum episode whose angle is near upright where told; last info."""
    env = gym.make("IntegPendulum-v0", dt=0.05, duration=0.05 * len(states_inside)).unwrapped
    env.reset(options={"state": (pi, 0.0)})
    for inside in states_inside:
        theta = 0.1 if inside else 1.0
        state = env._state
        env._state = state._replace(q=(theta,), v=(0.0,))
        *_, truncated, info = env.step(np.zeros(1))
    assert truncated
    return info


@pytest.mark.parametrize(
    ("inside", "success"),
    [(41, True), (40, False), (60, True)],
)
def test_swing_up_success_needs_the_last_two_seconds(inside, success):
    info = _swing([False] * 20 + [True] * inside)
    assert info["success"] is success
    assert info["goal_since"] == pytest.approx(0.05 * 21)


def test_balance_succeeds_only_by_lasting():
    env = gym.make("IntegCartPole-v0", integrator="reference", duration=0.1)
    env.reset(options={"state": (0.0, 0.0, 0.0, 0.0)})
    for k in range(5):
        *_, truncated, info = env.step(k % 2)
        assert info["success"] is (k == 4) is truncated
    assert info["goal_since"] == 0.0


@pytest.mark.parametrize("env_id", IDS)
@pytest.mark.parametrize("where", ["speed", "stiff step"])
def test_divergence_ends_the_episode_and_never_pays(env_id, where):
    springy = "stiffness" in environment_setup(env_id, {}).arguments()
    stiff = {"stiffness": 1e9} if springy else {"gravity": 1e6}
    stiff = {"max_torque": 1e6} if env_id == REACHER else stiff
    flies, fast = env_id == "IntegQuadrotor-v0", where == "speed"
    arguments = {"damping": 0.0} if fast else stiff
    arguments |= {"actuator": "effort"} if env_id == REACHER else UNLIMITED.get(env_id, {})
    env = gym.make(env_id, integrator="explicit_euler", dt=0.05, **arguments)
    n = env.unwrapped.setup.plant.coordinates
    state = np.zeros(2 * len(n))
    state[-2] = 1.0 if env_id == "IntegPendulum-v0" else 0.1
    if fast:
        state[3 if flies or env_id == REACHER else 1] = (1e-9 - DIVERGENCE_SPEED) * (
            1.0 if flies else -1.0
        )
    state = to_public_order(env.unwrapped.setup.task, state)
    env.reset(options={"state": state})
    action = getattr(env.action_space, "high", 1)
    obs, reward, terminated, truncated, info = env.step(action)
    assert (terminated, truncated, info["solver_status"]) == (True, False, "diverged")
    assert np.isfinite(obs).all()
    assert info["success"] is False
    np.testing.assert_array_equal(env.unwrapped.state, state)
    floor = {
        "IntegPendulum-v0": -200 * (pi**2 + 0.1 * DIVERGENCE_SPEED**2 + 0.001 * 4.0),
    }.get(env_id, 0.0)
    assert reward <= floor + 1e-9


def test_arithmetic_errors_are_divergences():
    env = gym.make("IntegPendulum-v0", integrator=f"{__name__}:Overflowing")
    env.reset(seed=0)
    *_, terminated, _, info = env.step(np.zeros(1))
    assert (terminated, info["solver_status"]) == (True, "diverged")


class Overflowing:
    """Raises what Python raises where an array would hold an infinity."""

    def step(self, ops, system, q, v, losses, control, dt):
        from integ_gym.envs.integrators.interface import Step

        return Step((q[0] + 1e200**2,), v, losses)


def test_unsolvable_step_is_reported():
    env = gym.make("IntegPendulum-v0", integrator=f"{__name__}:NeverConverging")
    env.reset(seed=0)
    *_, info = env.step(np.zeros(1))
    assert info["solver_status"] == "not_converged"
    assert info["solver_residual"] == 0.5
    assert info["solver_iterations"] == 9


class NeverConverging:
    """Reports a residual above its tolerance."""

    def step(self, ops, system, q, v, losses, control, dt):
        from integ_gym.envs.integrators.interface import Step

        return Step(q, v, losses, 9, 0.5, False)


def test_step_before_reset_is_refused():
    env = IntegPendulumEnv()
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(1))


def test_a_start_above_the_speed_limit_is_refused():
    """From there a divergence could end an episode with less loss than going on."""
    env = gym.make("IntegPendulum-v0", max_speed=8.0)
    env.reset(options={"state": (0.0, 8.0)})
    with pytest.raises(ValueError, match="speeds up to 8, got"):
        env.reset(options={"state": (0.0, 8.1)})
