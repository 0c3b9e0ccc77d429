"""Testbeds: what every one promises, and that what is applied is held against what was asked."""

from __future__ import annotations

import builtins
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from engine_cases import needs

import integ_gym
from integ_gym.envs.foreign import SURVIVAL
from integ_gym.envs.settings import Discretization
from integ_gym.envs.testbeds.gym_testbed import CLASSIC, Applied
from integ_gym.envs.testbeds.making import (
    IntegTestbed,
    find_testbed,
    make_checked,
    make_training_environments,
    stock_task,
)

TASK = "InvertedPendulum-v5"
EVERY = (*integ_gym.ENVIRONMENTS, *CLASSIC, TASK)


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    """Of its own: MuJoCo's compiler writes a file where it has a remark on a model."""
    monkeypatch.chdir(tmp_path)


def _testbed(env_id, **arguments):
    if env_id == TASK:
        needs("mujoco")
    return find_testbed(env_id, arguments)


class Lacking(integ_gym.GymTestbed):
    """It does not say what its home is."""


class Silent(integ_gym.GymTestbed):
    """It does not say what its environment applies."""

    home = Discretization("rk4", 0.2, 0.2, "gymnasium")
    choices = ("rk4",)

    def build(self, discretization, **arguments):
        return gym.make("Acrobot-v1")

    def applied(self, environments):
        return None

    def read(self, env):
        return Applied(self.home, 1)


class Mistaken(Silent):
    """It reads what it has not held."""

    def read(self, env):
        return self.as_applied("rk4", 0.2, env)


@pytest.mark.parametrize(
    ("owner", "message"),
    [
        (Lacking, "lacks home; docs/how-to/testbeds.md says"),
        (Silent, "must state what is applied by an Applied, got None"),
        (Mistaken, "which is for environments that `build` gives to `held`"),
    ],
)
def test_a_testbed_of_ones_own_with_a_mistake_is_told_which(owner, message):
    def made():
        testbed = find_testbed(f"{__name__}:{owner.__name__}", {})
        return make_checked(testbed, testbed.home, 1)

    with pytest.raises((TypeError, ValueError), match=message):
        made()


@pytest.mark.parametrize("env_id", EVERY)
def test_every_offer_is_made_and_really_applied(env_id):
    testbed = _testbed(env_id)
    home = testbed.home
    offered = [
        replace(home, integrator=name, dt=dt)
        for name in testbed.integrators(home.engine)
        for dt in testbed.steps(home)
    ]
    truth = testbed.truth(home.control_period)
    firsts = {one.integrator: one for one in reversed(offered)}
    for asked in (home, offered[-1], *firsts.values(), *([] if truth is None else [truth])):
        environments = make_checked(testbed, asked, 2)
        applied = testbed.applied(environments)
        assert applied.discretization == asked
        assert applied.substeps == round(asked.control_period / asked.dt)
        assert environments.num_envs == 2
        environments.reset(seed=[3, 4])
        environments.step(environments.action_space.sample())
        assert environments.state.shape[0] == 2
        environments.close()
    assert len(offered) == 3 * len(testbed.integrators(home.engine)) >= 3


@pytest.mark.parametrize("env_id", EVERY)
def test_lanes_are_the_single_environments(env_id):
    """Same seeds, same actions: the same observations and rewards, to the bit."""
    testbed = _testbed(env_id)
    environments = make_checked(testbed, testbed.home, 2)
    single = gym.make(env_id)
    if env_id == TASK:
        single = integ_gym.rediscretize(single)
    observation, _ = environments.reset(seed=[5, 6])
    assert np.array_equal(single.reset(seed=6)[0], observation[1])
    environments.action_space.seed(0)
    for _ in range(20):
        actions = environments.action_space.sample()
        observation, reward, terminated, _, info = environments.step(actions)
        expected, earned, ended, _, told = single.step(actions[1])
        assert np.array_equal(observation[1], expected)
        assert (reward[1], terminated[1]) == (earned, ended)
        if env_id in CLASSIC:
            assert np.isnan(info["energy"]).all()
            assert not info["_energy"].any()
        else:
            assert info["energy"][1] == told["energy"]
            assert np.array_equal(environments.state[1], single.unwrapped.state
                                  if env_id != TASK else single.state)  # fmt: skip
        if ended:
            break


class Rounding(IntegTestbed):
    """A testbed whose library rounds its step to milliseconds without a word."""

    def __init__(self, **arguments):
        super().__init__("IntegPendulum-v0", **arguments)

    def make(self, discretization, lanes, **arguments):
        rounded = replace(discretization, dt=round(discretization.dt, 3))
        return super().make(rounded, lanes, **arguments)


class Truncating(IntegTestbed):
    """A testbed that takes one sub-step too few."""

    def __init__(self, **arguments):
        super().__init__("IntegPendulum-v0", **arguments)

    def applied(self, environments):
        applied = super().applied(environments)
        return Applied(applied.discretization, applied.substeps - 1)


def test_a_step_that_is_rounded_is_refused_with_both_values():
    testbed = find_testbed(f"{__name__}:Rounding", {"max_torque": 1.0})
    exact = Discretization("rk4", 0.025, 0.05)
    make_checked(testbed, exact, 1).close()
    with pytest.raises(ValueError, match=r"`dt`=0\.01202 was asked for, .* applies 0\.012;"):
        make_checked(testbed, Discretization("rk4", 0.01202, 0.6), 1)


def test_sub_steps_that_do_not_fill_the_control_period_are_refused():
    testbed = find_testbed(f"{__name__}:Truncating", {})
    with pytest.raises(ValueError, match=r"`control_period`=0\.05 was asked .* applies 0\.025;"):
        make_checked(testbed, Discretization("rk4", 0.025, 0.05), 1)


@pytest.mark.parametrize(
    ("env_id", "message"),
    [
        ("IntegPendulun-v0", "unknown environment: .*Did you mean 'IntegPendulum-v0'"),
        ("MountainCar-v0", "'MountainCar-v0' is no MuJoCo task; give IntegAcrobot-v0, "),
        ("no_such_module:Class", "cannot load testbed 'no_such_module:Class'"),
    ],
)
def test_unknown_ids_are_refused_with_what_is_possible(env_id, message):
    needs("mujoco")
    with pytest.raises(ValueError, match=message):
        _ = find_testbed(env_id, {}).home


@pytest.mark.parametrize("env_id", ["IntegPendulum-v0", "CartPole-v1", TASK])
def test_training_environments_have_what_is_stated_and_the_rest_from_home(env_id):
    testbed = _testbed(env_id)
    dt = testbed.home.dt / 2
    stated = {"dt": dt, "control_period": testbed.home.control_period}
    environments = make_training_environments(env_id, stated, 3)
    assert testbed.applied(environments).discretization == replace(testbed.home, dt=dt)
    assert environments.autoreset_mode is gym.vector.AutoresetMode.SAME_STEP
    environments.close()


class Raising(Silent):
    """Whose environment's constructor raises what it likes."""

    def __init__(self, kind="AssertionError", message="", **arguments):
        super().__init__(**arguments)
        self.kind, self.message = getattr(builtins, kind), message

    def build(self, discretization, **arguments):
        raise self.kind(*filter(None, [self.message]))


@pytest.mark.parametrize("kind", ["AssertionError", "KeyError"])
def test_whatever_a_constructor_raises_is_one_sentence(kind):
    testbed = find_testbed(f"{__name__}:Raising", {"kind": kind, "message": "no such door"})
    with pytest.raises(ValueError, match="of Raising cannot be made: " + kind + ".*no such door"):
        make_checked(testbed, testbed.home, 1)
    with pytest.raises(ValueError, match="of Raising cannot be made: " + kind + ".*no such door"):
        _ = testbed.success


@pytest.mark.parametrize(
    ("env_id", "goal"),
    [
        ("Acrobot-v1", "return of at least -100"),
        ("CartPole-v1", SURVIVAL),
        ("Hopper-v5", SURVIVAL),
        ("Reacher-v5", "return of at least -3.75"),
    ],
)
def test_where_a_task_ends_at_its_goal_surviving_is_no_success(env_id, goal):
    if env_id not in CLASSIC:
        needs("mujoco")
    testbed = find_testbed(env_id, {})
    assert testbed.success.goal == goal
    environments = make_checked(testbed, testbed.home, 1)
    assert environments.setups[0].task.goal == goal
    environments.close()
    stated = find_testbed(env_id, {"success_return": -7.5})
    assert stated.success.goal == "return of at least -7.5"


class Car(Silent):
    """A task that ends at its goal, made by a testbed of one's own."""

    home = Discretization("rk4", 1.0, 1.0, "gymnasium")
    env_id = "MountainCarContinuous-v0"

    def build(self, discretization, **arguments):
        return gym.make(self.env_id)


def test_without_a_threshold_a_return_is_asked_for(monkeypatch):
    monkeypatch.setattr(gym.registry["MountainCarContinuous-v0"], "reward_threshold", None)
    testbed = Car()
    asked = "MountainCarContinuous ends at its goal, .* success: --success-return R with evaluate"
    with pytest.raises(ValueError, match=asked):
        _ = testbed.success
    with pytest.raises(ValueError, match=asked):
        testbed.lane(testbed.home, {})
    assert Car(success_return=80.0).success.goal == "return of at least 80"


def test_a_deprecated_model_file_is_not_written_about(tmp_path, capfd):
    """MuJoCo warns of Gymnasium's half_cheetah.xml at each compilation, there and in a file."""
    needs("mujoco")
    import mujoco

    before = mujoco.get_mju_user_warning()
    stock_task("HalfCheetah-v5", {}).close()
    assert (capfd.readouterr().err, list(tmp_path.iterdir())) == ("", [])
    assert mujoco.get_mju_user_warning() is before
