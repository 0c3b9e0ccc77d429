"""Starts of many lanes are those that each lane's own generator would draw."""

from __future__ import annotations

import json
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.envs.settings import DISCRETIZATION, Discretization, agrees
from integ_gym.envs.starts import AT_ONCE, LaneStarts, numbers_per_start
from integ_gym.envs.tasks.pendulum import PendulumSwingUp

LANES = 3


def _pair(env_id, **arguments):
    ours = gym.make_vec(env_id, num_envs=LANES, autoreset_mode=AutoresetMode.DISABLED, **arguments)
    sync = SyncVectorEnv(
        [lambda: gym.make(env_id, **arguments) for _ in range(LANES)],
        autoreset_mode=AutoresetMode.DISABLED,
    )
    return ours, sync


def _assert_same_states(ours, sync):
    np.testing.assert_array_equal(ours.state, [env.unwrapped.state for env in sync.envs])


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_start_after_start_is_the_single_environments(env_id):
    ours, sync = _pair(env_id)
    ours.reset(seed=4), sync.reset(seed=4)
    _assert_same_states(ours, sync)
    rng = np.random.default_rng(0)
    for _ in range(3 * AT_ONCE):
        mask = rng.random(LANES) < 0.5
        if mask.any():
            options = {"reset_mask": mask}
            ours.reset(options=options), sync.reset(options=options)
            _assert_same_states(ours, sync)


def test_options_seeds_and_given_states_in_between():
    ours, sync = _pair("IntegPendulum-v0")
    state = {"state": np.full((LANES, 2), 0.5)}
    one = {"reset_mask": np.array([False, True, False])}
    for seed, options in (
        (1, {}), (None, {"x_init": 0.1, "y_init": 0.3}), (None, state), (None, {}),
        ([None, 7, None], one), (None, {}), (None, {"x_init": 2.0}),
    ):  # fmt: skip
        ours.reset(seed=seed, options=options)
        if options is state:
            for env in sync.envs:
                env.reset(options={"state": (0.5, 0.5)})
        else:
            sync.reset(seed=seed, options=options)
        _assert_same_states(ours, sync)


def test_whoever_looks_at_the_generators_finds_them_where_they_belong():
    ours, sync = _pair("IntegCartPole-v0")
    for _ in range(2):
        ours.reset(seed=1), sync.reset(seed=1)
        for drawn in range(3):
            ours.reset(), sync.reset()
            pairs = zip(ours.np_random, (env.unwrapped.np_random for env in sync.envs), strict=True)
            for mine, theirs in pairs:
                assert mine.bit_generator.state == theirs.bit_generator.state
                assert mine.integers(9, size=drawn).tolist() == (
                    theirs.integers(9, size=drawn).tolist()
                )
            _assert_same_states(ours, sync)


class Normal(PendulumSwingUp):
    """Draws something else."""

    def draw_start(self, rng, start, options):
        return tuple(rng.normal(size=2))


class Careful(PendulumSwingUp):
    """Insists on floats."""

    def draw_start(self, rng, start, options):
        return float(rng.uniform()), float(rng.uniform())


class Rounding(PendulumSwingUp):
    """What it does to many at once is not what it does to each."""

    def draw_start(self, rng, start, options):
        x = rng.uniform()
        return x - np.max(x), rng.uniform()


@pytest.mark.parametrize("task", [Normal, Careful, Rounding])
def test_other_tasks_draw_one_by_one(task):
    setup = environment_setup("IntegPendulum-v0", {})
    assert numbers_per_start(type(setup)(**{**vars(setup), "task": task()})) is None


def test_an_impossible_start_is_refused_when_it_is_drawn():
    """Not when it is made ahead: the lanes whose starts are possible go on."""
    setup = environment_setup("IntegPendulum-v0", {"max_speed": 1.0})
    fast = type(setup)(**{**vars(setup), "task": Faster()})
    starts = LaneStarts(fast, [np.random.default_rng(k) for k in range(8)], 2)
    speeds = np.array([np.random.default_rng(k).random(2)[1] for k in range(8)])
    slow, quick = np.flatnonzero(speeds <= 0.5), np.flatnonzero(speeds > 0.5)
    begun = starts.begin(slow, lambda state: ())
    np.testing.assert_array_equal(begun.values[1], 2.0 * speeds[slow])
    with pytest.raises(ValueError, match=r"speeds up to 1, got"):
        starts.begin(quick[:1], lambda state: ())


class Faster(PendulumSwingUp):
    """Some of its starts are faster than a motion may be."""

    def draw_start(self, rng, start, options):
        return rng.uniform(), 2.0 * rng.uniform()


RK4 = Discretization("rk4", 0.1 + 0.2, 0.6)


def test_a_step_is_the_same_from_a_file_and_from_a_division():
    for dt in (0.3, 0.9 / 3.0):
        same = replace(RK4, dt=dt)
        assert same == RK4
        assert len({same, RK4}) == 1
    assert RK4.dt == 0.1 + 0.2
    assert Discretization(**json.loads(json.dumps(RK4.arguments()))).arguments() == RK4.arguments()
    assert tuple(RK4.arguments()) == DISCRETIZATION
    assert agrees({"integrator": "rk4", "dt": 0.3}, RK4.arguments())


def test_what_differs_is_another():
    nearly = {"dt": 0.3 * (1 + 1e-9)}
    for changes in (nearly, {"control_period": 0.3}, {"engine": "mujoco"}, {"integrator": "x"}):
        other = replace(RK4, **changes)
        assert other != RK4
        assert len({other, RK4}) == 2
        assert not agrees(other.arguments(), RK4.arguments())
    assert RK4 != "rk4"


def test_an_environment_tells_its_own():
    for env_id in ENVIRONMENTS:
        env = gym.make(env_id, integrator="rk4", dt=0.05 / 3, control_period=0.05)
        found = Discretization.of(env.unwrapped.setup)
        assert found == Discretization("rk4", 0.016666666666666666, 0.05)
