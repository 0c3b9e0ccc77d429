"""Environments of others at another control period than their own."""

from __future__ import annotations

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import FrameStackObservation, TimeLimit

import integ_gym
from integ_gym.envs.testbeds.making import find_testbed, make_checked


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
