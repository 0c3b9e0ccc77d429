"""Testbeds of one's own: docs/how-to/testbeds.md's example, and Gymnasium's classic control."""

from __future__ import annotations

import re
import sys
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.wrappers import RescaleAction, TimeLimit, TransformObservation, TransformReward
from house import ROOT
from mountain_car import MountainCar, ScaledMountainCar, swing

from integ_gym.envs.foreign import Repeated, StatedEnv, time_limit, wrappers_of
from integ_gym.envs.settings import Discretization
from integ_gym.envs.testbeds.gym_testbed import GymTestbed
from integ_gym.envs.testbeds.making import find_testbed, make_checked

PAGE = (ROOT / "docs" / "how-to" / "testbeds.md").read_text(encoding="utf-8")


@pytest.fixture
def acrobot(tmp_path, monkeypatch):
    """The page's testbed, by its reference."""
    ((name, block),) = re.findall(r"^```python\n# (my_testbed)\.py\n(.*?)^```", PAGE, re.M | re.S)
    (tmp_path / f"{name}.py").write_text(block, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    yield f"{name}:Acrobot"
    sys.modules.pop(name, None)


def test_the_example_keeps_its_decisions_at_every_step(acrobot):
    testbed = find_testbed(acrobot, {"success_return": -150.0})
    assert testbed.success.goal == "return of at least -150"
    for dt, count in ((0.2, 1), (0.1, 2), (0.05, 4)):
        environments = make_checked(testbed, replace(testbed.home, dt=dt), 2)
        assert testbed.applied(environments).substeps == count
        assert environments.setups[0].timing.horizon == 500
        environments.reset(seed=0)
        *_, reward, terminated, _, info = environments.step(np.zeros(2, int))
        assert (reward == -1.0).all()
        assert not terminated.any()
        np.testing.assert_allclose(info["time"], 0.2)
        environments.close()


def test_a_step_that_does_not_divide_is_refused(acrobot):
    testbed = find_testbed(acrobot, {})
    for change, message in (
        ({"dt": 0.03}, r"`control_period`=0.2 s is not a whole multiple"),
        ({"integrator": "euler"}, "unknown integrator of Acrobot 'euler'"),
        ({"engine": "mujoco"}, "unknown engine of Acrobot 'mujoco'"),
    ):
        with pytest.raises(ValueError, match=message):
            make_checked(testbed, replace(testbed.home, **change), 1)


class Deaf(GymTestbed):
    """Of a library that keeps its own step whatever is asked."""

    home = Discretization("symplectic_euler", 0.05, 0.05, "gymnasium")
    choices = ("symplectic_euler",)

    def build(self, discretization, **arguments):
        return self.held(gym.make("Pendulum-v1", **arguments), self.home)

    def read(self, env):
        return self.as_applied("symplectic_euler", env.unwrapped.dt, env)


def test_what_is_applied_decides():
    deaf = find_testbed(f"{__name__}:Deaf", {"g": 9.81})
    make_checked(deaf, deaf.home, 1).close()
    with pytest.raises(ValueError, match=r"`dt`=0\.025 was asked for, .* applies 0\.05;"):
        make_checked(deaf, replace(deaf.home, dt=0.025), 1)


@pytest.mark.parametrize("action", [np.nan, np.inf, 10**400], ids=["nan", "inf", "huge"])
def test_an_action_that_is_none_holds_the_last(action):
    env = StatedEnv(gym.make("CartPole-v1"), Discretization("euler", 0.02, 0.02, "gymnasium"))
    env.reset(seed=0)
    *_, info = env.step(1)
    assert (info["fallback_used"], info["saturated"]) == (False, False)
    *_, info = env.step(action)
    assert info["fallback_used"]
    assert info["action0_applied"] == 1.0
    *_, info = env.step(7)
    assert (info["action0_commanded"], info["action0_applied"], info["saturated"]) == (1, 1, True)


def test_without_a_time_limit_it_is_refused():
    bare = Repeated(gym.make("CartPole-v1").unwrapped, 1)
    with pytest.raises(ValueError, match="has no time limit"):
        StatedEnv(bare, Discretization("euler", 0.02, 0.02, "gymnasium"))


def _return(testbed, dt, seed=0):
    environments = make_checked(testbed, replace(testbed.home, dt=dt), 1)
    observation, _ = environments.reset(seed=seed)
    total, ended = 0.0, False
    while not ended:
        observation, reward, terminated, truncated, _ = environments.step(
            np.array([swing(observation[0])], np.float32)
        )
        total, ended = total + reward[0], bool(terminated[0] or truncated[0])
    assert terminated[0]
    return total


@pytest.mark.parametrize("kind", [MountainCar, ScaledMountainCar])
def test_a_goal_pays_the_same_at_every_step(kind):
    """The bonus counts whole, and costs add up to the same over the same time."""
    returns = [_return(kind(), dt) for dt in (1.0, 0.5, 0.25)]
    assert 80.0 < returns[0] < 95.0
    np.testing.assert_allclose(returns, returns[0], atol=2.0)


class Paying(gym.Env):
    """Pays 1, 2, 3, …; the fifth step ends it, with 100."""

    observation_space = gym.spaces.Box(-1.0, 1.0, (1,))
    action_space = gym.spaces.Box(-2.0, 2.0, (1,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.taken, self.given = 0, []
        return np.zeros(1, np.float32), {}

    def step(self, action):
        self.taken += 1
        self.given.append(float(action[0]))
        ends = self.taken == 5
        return np.zeros(1, np.float32), 100.0 if ends else self.taken, ends, False, {}


@pytest.mark.parametrize(
    ("rewards", "expected"),
    [
        ("rate", [1.5, 3.5, 100.0]),
        (None, [1.5, 3.5, 100.0]),
        ("sum", [3.0, 7.0, 100.0]),
        ("last", [2.0, 4.0, 100.0]),
    ],
)
def test_rewards_are_what_they_are_said_to_be(rewards, expected):
    env = Repeated(Paying(), 2, rewards)
    env.reset(seed=0)
    assert [env.step([0.0])[1] for _ in range(3)] == expected
    env = Repeated(Paying(), 3, rewards)
    env.reset(seed=0)
    first = {"sum": 6.0, "last": 3.0}.get(rewards, 2.0)
    second = {"sum": 104.0, "last": 100.0}.get(rewards, 4.0 / 3.0 + 100.0)
    np.testing.assert_allclose([env.step([0.0])[1] for _ in range(2)], [first, second])
    assert env.rewards_assumed is (rewards is None)


class Held(GymTestbed):
    """Of which `held` alone is asked."""

    home = Discretization("euler", 1.0, 1.0, "gymnasium")
    choices = ("euler",)


FINE = Discretization("euler", 0.25, 1.0, "gymnasium")


def test_wrappers_stay_and_act_in_every_step():
    seen = []

    def noted(reward):
        seen.append(reward)
        return 10.0 * reward

    env = RescaleAction(TimeLimit(Paying(), 7), np.float32(-1.0), np.float32(1.0))
    env = TransformReward(TransformObservation(env, lambda x: x + 0.5, None), noted)
    held = Held().held(TimeLimit(env, 9), FINE, "sum")
    assert held.action_space == gym.spaces.Box(-1.0, 1.0, (1,))
    names = [type(one).__name__ for one in wrappers_of(held)]
    assert names == [
        "TimeLimit", "Repeated", "TransformReward", "TransformObservation", "RescaleAction",
    ]  # fmt: skip
    assert time_limit(held) == 7
    held.reset(seed=0)
    observation, reward, *_ = held.step(np.array([0.5], np.float32))
    assert held.unwrapped.given == [1.0] * 4
    assert seen == [1, 2, 3, 4]
    assert reward == 100.0
    assert observation == [0.5]


@pytest.mark.parametrize(
    ("wrapper", "arguments"),
    [
        (wrappers.FrameStackObservation, {"stack_size": 2}),
        (wrappers.StickyAction, {"repeat_action_probability": 0.2}),
        (wrappers.MaxAndSkipObservation, {"skip": 2}),
        (wrappers.NormalizeReward, {}),
        (wrappers.Autoreset, {}),
    ],
)
def test_a_wrapper_that_cannot_be_kept_is_refused_by_name(wrapper, arguments):
    env = wrappers.ClipReward(wrapper(gym.make("Acrobot-v1"), **arguments), -1.0, 1.0)
    with pytest.raises(ValueError, match=f"`held` cannot keep the wrapper {wrapper.__name__}: it"):
        Held().held(env, FINE)
