"""Testbeds of one's own: docs/how-to/testbeds.md's example, and Gymnasium's classic control."""

from __future__ import annotations

import re
import sys
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from house import ROOT

from integ_gym import (
    Discretization,
    EpisodeContext,
    EvidenceStore,
    GymTestbed,
    RecordVectorEvidence,
)
from integ_gym.envs import testbeds
from integ_gym.envs.environments.stated import Repeated, StatedEnv
from integ_gym.envs.testbeds.classic_control import CLASSIC

PAGE = (ROOT / "docs" / "how-to" / "testbeds.md").read_text(encoding="utf-8")


@pytest.fixture
def acrobot(tmp_path, monkeypatch):
    """The page's testbed, by its reference."""
    ((name, block),) = re.findall(r"^```python\n# (\w+)\.py\n(.*?)^```", PAGE, re.M | re.S)
    (tmp_path / f"{name}.py").write_text(block, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    yield f"{name}:Acrobot"
    sys.modules.pop(name, None)


def test_the_example_keeps_its_decisions_at_every_step(acrobot):
    testbed = testbeds.testbed_of(acrobot, {"success_return": -150.0})
    assert testbed.success.goal == "return of at least -150"
    for dt, count in ((0.2, 1), (0.1, 2), (0.05, 4)):
        environments = testbeds.make_checked(testbed, replace(testbed.home, dt=dt), 2)
        assert testbed.applied(environments).substeps == count
        assert environments.setups[0].timing.horizon == 500
        environments.reset(seed=0)
        *_, reward, terminated, _, info = environments.step(np.zeros(2, int))
        assert (reward == -1.0).all()
        assert not terminated.any()
        np.testing.assert_allclose(info["time"], 0.2)
        environments.close()


def test_a_step_that_does_not_divide_is_refused(acrobot):
    testbed = testbeds.testbed_of(acrobot, {})
    for change, message in (
        ({"dt": 0.03}, r"`control_period`=0.2 s is not a whole multiple"),
        ({"integrator": "euler"}, "unknown integrator of Acrobot 'euler'"),
        ({"engine": "mujoco"}, "unknown engine of Acrobot 'mujoco'"),
    ):
        with pytest.raises(ValueError, match=message):
            testbeds.make_checked(testbed, replace(testbed.home, **change), 1)


class Deaf(GymTestbed):
    """Of a library that keeps its own step whatever is asked."""

    home = Discretization("symplectic_euler", 0.05, 0.05, "gymnasium")
    choices = ("symplectic_euler",)

    def build(self, discretization, **arguments):
        return self.held(gym.make("Pendulum-v1", **arguments), self.home)

    def read(self, env):
        return self.as_applied("symplectic_euler", env.unwrapped.dt, env)


def test_what_is_applied_decides():
    deaf = testbeds.testbed_of(f"{__name__}:Deaf", {"g": 9.81})
    testbeds.make_checked(deaf, deaf.home, 1).close()
    with pytest.raises(ValueError, match=r"`dt`=0\.025 was asked for, .* applies 0\.05;"):
        testbeds.make_checked(deaf, replace(deaf.home, dt=0.025), 1)


@pytest.mark.parametrize("env_id", CLASSIC)
def test_at_home_it_is_the_library_s_own(env_id):
    """Same seed, same actions: the same observations and rewards, to the bit."""
    testbed, stock = testbeds.testbed_of(env_id, {}), gym.make(env_id)
    environments = testbeds.make_checked(testbed, testbed.home, 1)
    observation, _ = environments.reset(seed=3)
    assert np.array_equal(observation[0], stock.reset(seed=3)[0])
    stock.action_space.seed(3)
    for _ in range(20):
        action = stock.action_space.sample()
        expected, earned, terminated, *_ = stock.step(action)
        observation, reward, ended, *_ = environments.step(np.array([action]))
        assert np.array_equal(observation[0], expected)
        assert reward[0] == earned
        assert ended[0] == terminated
        if terminated:
            break


def test_what_is_not_known_is_null_in_records(tmp_path):
    testbed = testbeds.testbed_of("CartPole-v1", {})
    environments = testbeds.make_checked(testbed, replace(testbed.home, dt=0.01), 2)
    recorder = RecordVectorEvidence(environments, tmp_path, EpisodeContext("run", "cell"))
    recorder.reset(seed=[1, 2])
    for _ in range(60):
        recorder.step(np.ones(2, int))
    recorder.close()
    records = list(EvidenceStore(tmp_path).records())
    assert EvidenceStore(tmp_path).verify() == []
    assert records
    for record in records:
        assert (record["engine"], record["integrator"], record["dt"]) == (
            "gymnasium", "explicit_euler", 0.01,
        )  # fmt: skip
        assert record["control_period"] == 0.02
        assert record["success"] is False
        for name in ("energy_residual_total", "solver_iterations_max", "work_total"):
            assert record[name] is None, name


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
