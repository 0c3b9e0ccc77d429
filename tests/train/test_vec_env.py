"""The SB3 adapter gives what SB3's own `DummyVecEnv` gives, bit by bit."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorWrapper

import integ_gym  # noqa: F401  (registers the environments)

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

from integ_gym.train.vec_env import Sb3VecEnv

LANES = 4
STEPS = 120

CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "pendulum": ("IntegPendulum-v0", {"duration": 2.0, "max_torque": 1.0, "start": "hanging"}),
    "pendulum, noise and latency": (
        "IntegPendulum-v0",
        {
            "integrator": "rk4",
            "dt": 0.02,
            "control_period": 0.1,
            "sensor_period": 0.06,
            "observation_noise": 0.05,
            "action_latency": 0.12,
            "duration": 3.0,
            "max_speed": 8.0,
        },
    ),
    "pendulum, diverging": (
        "IntegPendulum-v0",
        {"integrator": "explicit_euler", "dt": 0.5, "max_torque": 900.0, "duration": 30.0},
    ),
    "cart-pole": ("IntegCartPole-v0", {"duration": 0.5, "theta_threshold": 0.15}),
    "cart-pole, noise and latency": (
        "IntegCartPole-v0",
        {"dt": 0.01, "control_period": 0.02, "observation_noise": 0.01, "action_latency": 0.01},
    ),
}


class Transparent(VectorWrapper[Any, Any, Any, Any, Any]):
    """Stands for a recorder: the API of the environment, nothing changed."""

    def __init__(self, env):
        super().__init__(env)
        self.steps_seen = 0

    def step(self, actions):
        self.steps_seen += 1
        return super().step(actions)


def vector(env_id, lanes=LANES, mode="SameStep", **arguments):
    return gym.make_vec(env_id, num_envs=lanes, autoreset_mode=mode, **arguments)


def singles(env_id, **arguments):
    return DummyVecEnv([lambda: gym.make(env_id, **arguments).unwrapped] * LANES)


def actions_of(env, count):
    env.action_space.seed(7)
    return [np.array([env.action_space.sample() for _ in range(LANES)]) for _ in range(count)]


def assert_same_value(ours, theirs, name):
    if isinstance(theirs, np.ndarray):
        assert ours.dtype == theirs.dtype, name
        np.testing.assert_array_equal(ours, theirs, err_msg=name, strict=True)
    else:
        assert ours == theirs, name
        assert type(ours) is type(theirs), name


def assert_same_infos(ours, theirs, ended):
    for lane, (mine, other) in enumerate(zip(ours, theirs, strict=True)):
        mine = dict(mine)
        if ended[lane]:
            assert mine.pop("is_success") is other["success"]
        assert set(mine) == set(other)
        for name in other:
            assert_same_value(mine[name], other[name], f"{name} in lane {lane}")


def assert_same(ours, theirs, steps, own=True):
    """Step both with the same actions; how often an episode was terminated or truncated."""
    assert list(ours.seed(11)) == list(theirs.seed(11)) == [11, 12, 13, 14]
    assert_same_value(ours.reset(), theirs.reset(), "first observation")
    ends = {"terminated": 0, "truncated": 0}
    with np.errstate(all="ignore"):
        for actions in actions_of(theirs, steps):
            mine, other = ours.step(actions), theirs.step(actions)
            for name, a, b in zip(("observation", "reward", "done"), mine, other, strict=False):
                assert_same_value(a, b, name)
            assert_same_infos(mine[3], other[3], other[2])
            if own:
                assert ours.reset_infos == theirs.reset_infos
            for info, done in zip(other[3], other[2], strict=True):
                ends["truncated"] += info["TimeLimit.truncated"]
                ends["terminated"] += done and not info["TimeLimit.truncated"]
    return ends


@pytest.mark.parametrize("case", CASES)
def test_equals_dummy_vec_env(case):
    env_id, arguments = CASES[case]
    bare = vector(env_id, **arguments)
    ours = Sb3VecEnv(Transparent(bare) if case in ("pendulum", "cart-pole") else bare)
    theirs = singles(env_id, **arguments)
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    ends = assert_same(ours, theirs, STEPS)
    if case in ("pendulum", "pendulum, noise and latency"):
        horizon = 40 if case == "pendulum" else 30
        assert ends == {"terminated": 0, "truncated": STEPS // horizon * LANES}
    else:
        assert ends["terminated"] >= LANES
    assert ends["truncated"] >= 1 or case != "cart-pole"


class Wandering(gym.Env[Any, Any]):
    """Observations in float64, two actions, and ends at random: nothing of our own."""

    observation_space = gym.spaces.Box(-np.inf, np.inf, (3,), np.float64)
    action_space = gym.spaces.Box(-1.0, 1.0, (2,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self.np_random.normal(size=3), {"success": False}

    def step(self, action):
        told = {"success": bool(self.np_random.random() < 0.5), "work": float(action.sum())}
        ended = self.np_random.random(2) < 0.1
        return self.np_random.normal(size=3), action[0], bool(ended[0]), bool(ended[1]), told


def test_any_vector_environment_equals_dummy_vec_env():
    ours = Sb3VecEnv(SyncVectorEnv([Wandering] * LANES, autoreset_mode=AutoresetMode.SAME_STEP))
    ends = assert_same(ours, DummyVecEnv([Wandering] * LANES), 100, own=False)
    assert min(ends.values()) >= LANES


def test_seeds_and_options_count_for_one_reset():
    ours, theirs = Sb3VecEnv(vector("IntegPendulum-v0")), singles("IntegPendulum-v0")
    states = [{"state": (0.1 * lane, 1.0)} for lane in range(LANES)]
    for env in (ours, theirs):
        env.seed(3)
        env.set_options({"x_init": 0.5, "y_init": 0.0})
    for options in (None, None, states, None):
        if options is not None:
            ours.set_options(options)
            theirs.set_options(options)
        assert_same_value(ours.reset(), theirs.reset(), "observation")
        assert ours.reset_infos == theirs.reset_infos
    ours.seed(3)
    again = ours.reset()
    ours.seed(3)
    np.testing.assert_array_equal(ours.reset(), again)


def test_lanes_with_different_options_and_other_autoreset_modes_are_refused():
    env = Sb3VecEnv(vector("IntegPendulum-v0"))
    env.set_options([{"x_init": 0.1 * lane} for lane in range(LANES)])
    with pytest.raises(ValueError, match="all lanes reset with the same options, `state` excepted"):
        env.reset()
    for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED):
        with pytest.raises(ValueError, match=r"autoreset_mode=AutoresetMode\.SAME_STEP"):
            Sb3VecEnv(vector("IntegPendulum-v0", mode=mode.value))


def test_attributes():
    env = Sb3VecEnv(Transparent(vector("IntegPendulum-v0", max_torque=1.5)))
    env.seed(0)
    env.reset()
    states = env.get_attr("state")
    assert [state.shape for state in states] == [(2,)] * LANES
    np.testing.assert_array_equal(states, env.vector_env.unwrapped.state)
    assert env.get_attr("np_random_seed", [1, 3]) == [1, 3]
    assert [setup.task.max_torque for setup in env.get_attr("setup", 2)] == [1.5]
    assert env.get_attr("steps_seen") == [0] * LANES
    assert env.get_attr("action_space", 0) == [env.action_space]
    assert env.get_attr("render_mode") == [None] * LANES
    assert not env.has_attr("no_such_thing")
    with pytest.raises(AttributeError, match="IntegPendulumVectorEnv has no 'no_such_thing'"):
        env.get_attr("no_such_thing")
    env.set_attr("note", "hello")
    assert env.get_attr("note", [0]) == ["hello"]
    with pytest.raises(ValueError, match=r"'note'.*leave `indices` out"):
        env.set_attr("note", "other", indices=[0, 1])
    with pytest.raises(NotImplementedError, match=r"call vector_env\.reset\(\.\.\.\) for all"):
        env.env_method("reset")
    assert env.env_is_wrapped(Monitor) == [False] * LANES
    assert env.env_is_wrapped(Transparent, [0]) == [True]
