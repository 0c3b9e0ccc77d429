"""Tasks of others with late commands and late observations, beside independent wrappers."""

from __future__ import annotations

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import FrameStackObservation, TimeLimit
from wire import Wire

import integ_gym
from integ_gym import Applied
from integ_gym.envs.testbeds.making import find_testbed, make_checked


class Delayed(gym.Wrapper):
    """Stock Hopper-v5 whose commands and observations are late by whole timesteps of MuJoCo's.

    The motion is advanced here, step by step; the reward is the task's formula, of the command that
    acts at the end of the decision.
    """

    def __init__(self, observation_steps, **late):
        super().__init__(gym.make("Hopper-v5").env)
        self.task, self.late, self.old = self.unwrapped, late, observation_steps

    def reset(self, *, seed=None, options=None):
        observation, info = self.env.reset(seed=seed)
        self.seen = [observation]
        self.wire = Wire(np.zeros(3), 4, **self.late, seed=seed)
        return observation, info

    def step(self, action):
        task, data = self.task, self.task.data
        before = data.qpos[0]
        for acting in self.wire.give(np.asarray(action, np.float64)):
            task.do_simulation(acting, 1)
            self.seen.append(task._get_obs())
        velocity = (data.qpos[0] - before) / 0.008
        reward, _ = task._get_rew(velocity, acting.astype(np.float32))
        shown = self.seen[max(0, len(self.seen) - 1 - self.old)]
        return shown, reward, not task.is_healthy, False, {}


@pytest.mark.parametrize(
    ("command", "observation", "jitter", "hold"),
    [
        (4, 0, 0, 0.0), (6, 0, 0, 0.0), (0, 4, 0, 0.0), (0, 6, 0, 0.0), (6, 3, 0, 0.0),
        (0, 0, 0, 0.3), (0, 0, 3, 0.0), (6, 3, 9, 0.3), (2, 4, 5, 0.1),
    ],
)  # fmt: skip
def test_returns_are_those_of_an_independent_wrapper(command, observation, jitter, hold):
    delays = {"action_latency": 0.002 * command, "observation_latency": 0.002 * observation}
    drawn = {"latency_jitter": 0.002 * jitter, "hold_probability": hold}
    env = integ_gym.rediscretize(gym.make("Hopper-v5"), **delays, **drawn)
    other = Delayed(observation, latency=command, jitter=jitter, hold=hold)
    seen, own = other.reset(seed=7)[0], env.reset(seed=7)[0]
    total = ours = 0.0
    for k in range(60):
        assert (seen == own).all()
        action = np.tanh(3.0 * seen[:3] + np.sin(k)).astype(np.float32)
        seen, reward, ended, *_ = other.step(action)
        own, paid, over, _, info = env.step(action)
        total, ours = total + reward, ours + paid
        assert ended == over
        assert ("command_held" in info) == bool(jitter or hold)
        if jitter or hold:
            assert info["command_held"] == other.wire.held
            assert info["command_latency"] == pytest.approx(0.002 * other.wire.late)
        assert info["sensor_time"] == pytest.approx(max(0.0, 0.008 * (k + 1) - 0.002 * observation))
        if ended:
            break
    assert k > 10
    assert ours == total


def test_a_delay_that_is_no_multiple_is_refused_with_the_nearest():
    with pytest.raises(ValueError, match=r"action_latency.*nearest valid: 0\.002 or 0\.004"):
        integ_gym.rediscretize(gym.make("Hopper-v5"), action_latency=0.003)


class LateCartPole(integ_gym.GymTestbed):
    """CartPole-v1 whose steps are decisions, which nothing divides."""

    home = integ_gym.Discretization("explicit_euler", 0.02, 0.02, "gymnasium")
    choices = ("explicit_euler",)

    def build(self, discretization, **arguments):
        return gym.make("CartPole-v1", **arguments)

    def read(self, env):
        return Applied(self.home, 1)


def test_a_task_that_changes_its_actions_itself_has_no_jitter():
    class Scaled(type(gym.make("Hopper-v5").unwrapped)):
        def do_simulation(self, control, count):
            raise AssertionError("it is advanced by rediscretize")

        def step(self, action):
            return super().step(0.5 * action)

    def made(**drawn):
        env = integ_gym.rediscretize(gym.wrappers.TimeLimit(Scaled(), 100), **drawn)
        env.reset(seed=0)
        return env

    env = made(action_latency=0.002, hold_probability=0.1)
    *_, info = env.step(np.ones(3, np.float32))
    assert {info[f"{name}_applied"] for name, _ in env.setup.plant.controls} == {0.5}
    with pytest.raises(ValueError, match="`latency_jitter` is not possible"):
        made(latency_jitter=0.002).step(np.ones(3, np.float32))


def test_what_is_drawn_leaves_starts_alone_and_is_each_episodes_own():
    def episodes(**drawn):
        env = integ_gym.rediscretize(gym.make("Hopper-v5"), **drawn)
        starts, lost = [], []
        for seed in (3, None, None, 3):
            starts.append(env.reset(seed=seed)[0])
            lost.append([env.step(np.zeros(3))[4].get("command_held") for _ in range(12)])
        return np.array(starts), lost

    plain, nothing = episodes()
    starts, lost = episodes(hold_probability=0.4)
    more = episodes(hold_probability=0.6)[1]
    assert (plain == starts).all()
    assert nothing == [[None] * 12] * 4
    assert lost[0] == lost[3]
    assert lost[0] != lost[1] != lost[2]
    assert (np.array(lost) <= np.array(more)).all()


@pytest.mark.parametrize(("jitter", "hold"), [(0, 0.0), (3, 0.3)])
@pytest.mark.parametrize(
    ("testbed", "env_id", "dt", "unit"),
    [
        (find_testbed("Pendulum-v1", {}), "Pendulum-v1", 0.0125, 0.0125),
        (LateCartPole(), "CartPole-v1", 0.02, 0.02),
    ],
)
def test_any_testbed_can_be_late_by_its_steps(testbed, env_id, dt, unit, jitter, hold):
    """Commands and observations beside the environment itself, step by step."""
    place = replace(testbed.home, dt=dt)
    delays = {"action_latency": 5 * unit, "observation_latency": 3 * unit}
    drawn = {"latency_jitter": jitter * unit, "hold_probability": hold}
    lanes = make_checked(testbed, place, 1, **delays, **drawn)
    other = gym.make(env_id).unwrapped
    if env_id == "Pendulum-v1":
        other.dt = dt
    shown, own = lanes.reset(seed=[4])[0][0], other.reset(seed=4)[0]
    count, seen = round(place.control_period / unit), [own] * 4
    wire = Wire(0.0, count, 5, jitter, hold, seed=4)
    for k in range(8):
        np.testing.assert_array_equal(shown, seen[-4])
        action = k % 2 if env_id == "CartPole-v1" else 2.0 * np.sin(k)
        for acting in wire.give(action):
            one = int(acting) if env_id == "CartPole-v1" else np.array([acting], np.float32)
            seen.append(other.step(one)[0])
        given = [action] if env_id == "CartPole-v1" else [[action]]
        shown, *_, info = lanes.step(np.array(given, lanes.action_space.dtype))
        shown = shown[0]
        late = max(0.0, place.control_period * (k + 1) - 3 * unit)
        assert info["sensor_time"][0] == pytest.approx(late)
        assert info["action0_applied"][0] == pytest.approx(acting)
        assert info["action0_commanded"][0] == pytest.approx(action)
        if drawn["hold_probability"]:
            assert info["command_held"][0] == wire.held
            assert info["command_latency"][0] == pytest.approx(wire.late * unit)
    with pytest.raises(ValueError, match="not a whole multiple"):
        make_checked(testbed, place, 1, action_latency=1.5 * unit)
    with pytest.raises(ValueError, match="`hold_probability` must be a number from 0 to below 1"):
        make_checked(testbed, place, 1, hold_probability=1.5)


def _stretched(env_id, factor):
    testbed = find_testbed(env_id, {})
    place = replace(testbed.home, control_period=factor * testbed.home.control_period)
    return make_checked(testbed, place, 1)


@pytest.mark.parametrize("env_id", ["CartPole-v1", "Acrobot-v1", "InvertedPendulum-v5"])
@pytest.mark.parametrize("factor", [2, 4])
def test_seconds_stay_and_returns_are_per_second(env_id, factor):
    own, longer = (_stretched(env_id, k).setups[0] for k in (1, factor))
    assert longer.settings.duration == pytest.approx(own.settings.duration)
    assert longer.timing.horizon == -(-own.timing.horizon // factor)
    assert longer.timing.substeps == factor * own.timing.substeps
    rewards = []
    for k in (1, factor):
        env = _stretched(env_id, k)
        env.reset(seed=0)
        action = np.zeros(env.action_space.shape, env.action_space.dtype)
        rewards.append(float(env.step(action)[1][0]))
        env.close()
    assert rewards[1] == pytest.approx(factor * rewards[0], rel=1e-12)


def test_a_mujoco_task_decides_less_often_as_with_another_frame_skip():
    """Rewards are the task's own at its period, times the ratio of the periods."""
    stock = gym.make("Hopper-v5", frame_skip=8)
    env = integ_gym.rediscretize(gym.make("Hopper-v5"), control_period=0.016)
    seen, own = (one.reset(seed=5)[0] for one in (stock, env))
    assert (seen == own).all()
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (40, 3)).astype(np.float32)
    for action in actions:
        (seen, reward, ended, *_), (own, paid, over, *_) = stock.step(action), env.step(action)
        assert (seen == own).all()
        assert paid == 2.0 * reward
        assert ended == over
        if ended:
            break
    assert env.setup.timing.horizon == 500
    assert env.get_wrapper_attr("_max_episode_steps") == 500


class Bonus(gym.Env):
    """Pays 1 for a step of 0.1 s, and 10 at its end after four of them."""

    observation_space = gym.spaces.Box(-1.0, 1.0, (1,))
    action_space = gym.spaces.Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.steps = 0
        return np.zeros(1, np.float32), {}

    def step(self, action):
        self.steps += 1
        ended = self.steps == 4
        return np.zeros(1, np.float32), 10.0 if ended else 1.0, ended, False, {}


class BonusTestbed(integ_gym.GymTestbed):
    home = integ_gym.Discretization("rk4", 0.1, 0.1, "bonus")
    choices = ("rk4",)

    def build(self, discretization, rewards="rate"):
        return self.held(TimeLimit(Bonus(), 10), discretization, rewards=rewards)

    def read(self, env):
        return self.as_applied("rk4", 0.1, env)


@pytest.mark.parametrize(
    ("rewards", "paid"), [("rate", [2.0, 1.0 + 10.0]), ("sum", [2.0, 11.0]), ("last", [2.0, 10.0])]
)
def test_the_reward_that_ends_an_episode_counts_whole(rewards, paid):
    testbed = BonusTestbed(rewards=rewards)
    env = make_checked(testbed, replace(testbed.home, control_period=0.2), 1)
    env.reset(seed=0)
    assert [float(env.step(np.zeros(1, int))[1][0]) for _ in range(2)] == paid
    assert env.setups[0].timing.horizon == 5


class StackedTestbed(BonusTestbed):
    def build(self, discretization):
        return FrameStackObservation(super().build(discretization), 2)


def test_what_counts_decisions_is_refused_by_name():
    testbed = StackedTestbed()
    make_checked(testbed, testbed.home, 1).close()
    with pytest.raises(ValueError, match="FrameStackObservation: it counts decisions"):
        make_checked(testbed, replace(testbed.home, control_period=0.2), 1)
    stacked = FrameStackObservation(gym.make("InvertedPendulum-v5"), 2)
    with pytest.raises(ValueError, match="FrameStackObservation"):
        integ_gym.rediscretize(stacked, control_period=0.08)
    with pytest.raises(ValueError, match="timestep"):
        integ_gym.rediscretize(gym.make("InvertedPendulum-v5"), control_period=0.05)
