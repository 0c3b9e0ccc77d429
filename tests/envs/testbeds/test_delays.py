"""Tasks of others with late commands and late observations, beside independent wrappers."""

from __future__ import annotations

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import integ_gym
from integ_gym import Applied
from integ_gym.envs.testbeds.making import find_testbed, make_checked


class Delayed(gym.Wrapper):
    """Stock Hopper-v5 whose commands and observations are late by whole timesteps of MuJoCo's.

    The motion is advanced here, step by step; the reward is the task's formula, of the command that
    acts at the end of the decision.
    """

    def __init__(self, command_steps, observation_steps):
        super().__init__(gym.make("Hopper-v5").env)
        self.task, self.late, self.old = self.unwrapped, command_steps, observation_steps

    def reset(self, *, seed=None, options=None):
        observation, info = self.env.reset(seed=seed)
        self.seen = [observation]
        self.queue = [np.zeros(3)] * self.late
        return observation, info

    def step(self, action):
        task, data = self.task, self.task.data
        self.queue += [np.asarray(action, np.float64)] * 4
        before = data.qpos[0]
        for _ in range(4):
            acting = self.queue.pop(0)
            task.do_simulation(acting, 1)
            self.seen.append(task._get_obs())
        velocity = (data.qpos[0] - before) / 0.008
        reward, _ = task._get_rew(velocity, acting.astype(np.float32))
        shown = self.seen[max(0, len(self.seen) - 1 - self.old)]
        return shown, reward, not task.is_healthy, False, {}


@pytest.mark.parametrize(("command", "observation"), [(4, 0), (6, 0), (0, 4), (0, 6), (6, 3)])
def test_returns_are_those_of_an_independent_wrapper(command, observation):
    delays = {"action_latency": 0.002 * command, "observation_latency": 0.002 * observation}
    env = integ_gym.rediscretize(gym.make("Hopper-v5"), **delays)
    other = Delayed(command, observation)
    seen, own = other.reset(seed=7)[0], env.reset(seed=7)[0]
    total = ours = 0.0
    for k in range(60):
        assert (seen == own).all()
        action = np.tanh(3.0 * seen[:3] + np.sin(k)).astype(np.float32)
        seen, reward, ended, *_ = other.step(action)
        own, paid, over, _, info = env.step(action)
        total, ours = total + reward, ours + paid
        assert ended == over
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


@pytest.mark.parametrize(
    ("testbed", "env_id", "dt", "unit"),
    [
        (find_testbed("Pendulum-v1", {}), "Pendulum-v1", 0.0125, 0.0125),
        (LateCartPole(), "CartPole-v1", 0.02, 0.02),
    ],
)
def test_any_testbed_can_be_late_by_its_steps(testbed, env_id, dt, unit):
    """Queues of commands and observations beside the environment itself, step by step."""
    place = replace(testbed.home, dt=dt)
    delays = {"action_latency": 5 * unit, "observation_latency": 3 * unit}
    lanes = make_checked(testbed, place, 1, **delays)
    other = gym.make(env_id).unwrapped
    if env_id == "Pendulum-v1":
        other.dt = dt
    shown, own = lanes.reset(seed=[4])[0][0], other.reset(seed=4)[0]
    commands, seen = [0.0] * 5, [own] * 4
    count = round(place.control_period / unit)
    for k in range(8):
        np.testing.assert_array_equal(shown, seen[-4])
        action = k % 2 if env_id == "CartPole-v1" else 2.0 * np.sin(k)
        commands += [action] * count
        for _ in range(count):
            acting = commands.pop(0)
            one = int(acting) if env_id == "CartPole-v1" else np.array([acting], np.float32)
            seen.append(other.step(one)[0])
        given = [action] if env_id == "CartPole-v1" else [[action]]
        shown, *_, info = lanes.step(np.array(given, lanes.action_space.dtype))
        shown = shown[0]
        late = max(0.0, place.control_period * (k + 1) - 3 * unit)
        assert info["sensor_time"][0] == pytest.approx(late)
    with pytest.raises(ValueError, match="not a whole multiple"):
        make_checked(testbed, place, 1, action_latency=1.5 * unit)
