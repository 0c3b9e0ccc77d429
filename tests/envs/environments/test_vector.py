"""The vector environment equals `SyncVectorEnv` of the single one."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from motions import ALL
from pairing import pairs
from sameness import assert_same

import integ_gym

LANES = 5
CASES = {
    "pendulum": ("IntegPendulum-v0", {"duration": 1.0}),
    "cart_pole": ("IntegCartPole-v0", {"duration": 0.5}),
    "everything": (
        "IntegPendulum-v0",
        {
            "integrator": "stormer_verlet", "dt": 0.01, "control_period": 0.05,
            "action_latency": 0.07, "sensor_period": 0.04, "observation_noise": 0.05,
            "duration": 0.8, "damping": 0.1, "max_speed": 6.0, "fallback": "zero",
            "mass_distribution": "point",
        },
    ),
    "late": (
        "IntegCartPole-v0",
        {"action_latency": 0.05, "sensor_period": 0.03, "dt": 0.01, "control_period": 0.02,
         "duration": 0.4},
    ),
    "lossy": (
        "IntegCartPole-v0",
        {"latency_jitter": 0.05, "dt": 0.01, "control_period": 0.02, "hold_probability": 0.2,
         "duration": 0.4},
    ),
    "mixed": (
        "IntegPendulum-v0",
        {
            "mixture": [
                {"integrator": "rk4", "dt": 0.05, "control_period": 0.05},
                {"integrator": "rk4", "dt": 0.025, "control_period": 0.1, "weight": 2},
                {"integrator": "explicit_euler", "dt": 0.05, "control_period": 0.2},
            ],
            "action_latency": 0.1, "observation_latency": 0.05, "latency_jitter": 0.1,
            "observation_noise": 0.05, "duration": 0.8,
        },
    ),
    "stopped": ("IntegPendulum-v0", {"joint_limit": 1.0, "start": "uniform", "duration": 1.0}),
    "diverging": (
        "IntegPendulum-v0",
        {"integrator": "explicit_euler", "dt": 0.5, "gravity": 500.0, "duration": 8.0},
    ),
}  # fmt: skip


def _pair(case: str, mode: AutoresetMode):
    env_id, arguments = CASES[case]
    ours = gym.make_vec(env_id, num_envs=LANES, autoreset_mode=mode, **arguments)
    sync = SyncVectorEnv(
        [lambda: gym.make(env_id, **arguments) for _ in range(LANES)], autoreset_mode=mode
    )
    return ours, sync


def _states(env):
    if isinstance(env, SyncVectorEnv):
        return np.array([e.unwrapped.state for e in env.envs])
    return env.state


@pytest.mark.parametrize(
    ("case", "mode"),
    [
        *(("everything", mode) for mode in AutoresetMode),
        ("pendulum", AutoresetMode.NEXT_STEP),
        ("cart_pole", AutoresetMode.SAME_STEP),
        ("late", AutoresetMode.DISABLED),
        *(("lossy", mode) for mode in AutoresetMode),
        *(("mixed", mode) for mode in AutoresetMode),
        ("stopped", AutoresetMode.NEXT_STEP),
        ("diverging", AutoresetMode.SAME_STEP),
    ],
)
@pytest.mark.filterwarnings("ignore:.*is not within the observation space:UserWarning")
def test_equals_sync_vector_env(case, mode):
    ours, sync = _pair(case, mode)
    assert ours.observation_space == sync.observation_space
    assert ours.action_space == sync.action_space
    assert_same(ours.reset(seed=3), sync.reset(seed=3), 1e-12)
    ours.action_space.seed(0)
    ended = 0
    for _ in range(70):
        actions = ours.action_space.sample()
        ours_step, sync_step = ours.step(actions), sync.step(actions)
        assert_same(ours_step, sync_step, 1e-12)
        np.testing.assert_allclose(_states(ours), _states(sync), rtol=1e-12, atol=1e-12)
        _copy_states(ours, sync)
        done = ours_step[2] | ours_step[3]
        ended += int(done.sum())
        if mode is AutoresetMode.DISABLED and done.any():
            resets = [env.reset(options={"reset_mask": done.copy()}) for env in (ours, sync)]
            assert_same(*resets, 1e-12)
    assert ended > LANES


def _copy_states(ours, sync):
    """Start the next step from identical floats, so that rounding cannot grow."""
    state = ours._state
    for lane, env in enumerate(sync.envs):
        single = env.unwrapped._state
        env.unwrapped._state = single._replace(
            q=tuple(float(x[lane]) for x in state.q),
            v=tuple(float(x[lane]) for x in state.v),
            energy=float(state.energy[lane]),
        )


@pytest.mark.parametrize(("integrator", "env_id"), pairs(ALL, integ_gym.ENVIRONMENTS, strength=1))
def test_every_integrator_equals_sync_vector_env(env_id, integrator):
    arguments = {"integrator": integrator, "dt": 0.01, "control_period": 0.02, "damping": 0.05}
    ours = gym.make_vec(env_id, num_envs=LANES, **arguments)
    sync = gym.make_vec(env_id, num_envs=LANES, vectorization_mode="sync", **arguments)
    ours.reset(seed=1), sync.reset(seed=1)
    ours.action_space.seed(1)
    for _ in range(25):
        actions = ours.action_space.sample()
        assert_same(ours.step(actions), sync.step(actions), 1e-12)
        _copy_states(ours, sync)


@pytest.mark.parametrize("env_id", integ_gym.ENVIRONMENTS)
def test_gymnasium_is_among_the_direct_bases(env_id):
    """By which libraries such as skrl tell whose environment it is."""
    ours = gym.make_vec(env_id, num_envs=1)
    assert gym.vector.VectorEnv in type(ours).__bases__
    assert gym.Env in type(gym.make(env_id).unwrapped).__bases__


def test_plant_parameters_may_differ_per_lane():
    masses = np.array([0.5, 1.0, 2.0])
    ours = gym.make_vec("IntegPendulum-v0", num_envs=3, mass=masses, integrator="rk4")
    ours.reset(options={"state": np.full((3, 2), 2.0)})
    ours.step(np.full((3, 1), 1.0))
    for lane, mass in enumerate(masses):
        single = gym.make("IntegPendulum-v0", mass=mass, integrator="rk4")
        single.reset(options={"state": (2.0, 2.0)})
        single.step(np.array([1.0]))
        np.testing.assert_allclose(ours.state[lane], single.unwrapped.state, rtol=1e-12)
    with pytest.raises(ValueError, match=r"one value per environment, shape \(4,\)"):
        gym.make_vec("IntegPendulum-v0", num_envs=4, mass=masses)


def test_arrays_are_refused_where_they_cannot_work():
    values = np.array([1.0, 2.0])
    with pytest.raises(ValueError, match=r"give arrays to gym\.make_vec"):
        gym.make("IntegPendulum-v0", mass=values)
    with pytest.raises(TypeError, match=r"`compiled` is for many .* give it to gym\.make_vec"):
        gym.make("IntegPendulum-v0", compiled=True)
    with pytest.raises(ValueError, match=r"`dt` must be one value.*got \[0\.05\].*`mixture` is a"):
        gym.make_vec("IntegPendulum-v0", num_envs=1, dt=[0.05])
    with pytest.raises(ValueError, match="`dt` must be one value"):
        gym.make_vec("IntegPendulum-v0", num_envs=2, dt=values)
    with pytest.raises(ValueError, match="`max_torque` must be a number or one value per"):
        gym.make_vec("IntegPendulum-v0", num_envs=3, max_torque=values)
    with pytest.raises(ValueError, match="`num_envs` must be 1 or above"):
        gym.make_vec("IntegPendulum-v0", num_envs=0)
    with pytest.raises(ValueError, match="unknown key in `mixture` 'mass'"):
        gym.make_vec("IntegPendulum-v0", num_envs=2, mixture=[{"dt": 0.05}, {"mass": 2.0}])


def test_wrong_use_is_refused():
    env = gym.make_vec("IntegCartPole-v0", num_envs=2, autoreset_mode="Disabled", duration=0.02)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(2))
    with pytest.raises(ValueError, match="one per lane"):
        env.reset(seed=[1, 2, 3])
    env.reset(seed=[1, 2])
    assert env.np_random_seed == (1, 2)
    for actions in (np.array([0, 7]), np.array([0.0, 0.5]), np.array([1.0, -1.0])):
        with pytest.raises(ValueError, match="lane 1"):
            env.step(actions)
    env.step(np.array([0.0, 1.0]))
    with pytest.raises(gym.error.ResetNeeded, match="reset_mask"):
        env.step(np.array([0, 1]))
    for mask in (np.array([1, 0]), np.array([True]), [True, False], np.zeros(2, bool)):
        with pytest.raises(ValueError, match="reset_mask"):
            env.reset(options={"reset_mask": mask})
    with pytest.raises(ValueError, match="one row per lane"):
        env.reset(options={"state": np.zeros((3, 4))})


def test_actions_of_lanes_that_are_being_reset_are_not_looked_at():
    envs = gym.make_vec("IntegCartPole-v0", num_envs=2, duration=0.02)
    envs.reset(seed=0)
    envs.step(np.array([0, 1]))
    envs.step(np.array([7, 1]))
    with pytest.raises(ValueError, match="actions must be"):
        envs.step(np.array([7, 1]))


def test_lanes_of_a_mixture_begin_with_their_own_engines_status():
    mixture = [
        {"engine": "mujoco", "integrator": "RK4"},
        {"engine": "native", "integrator": "rk4"},
    ]
    env = gym.make_vec("IntegPendulum-v0", num_envs=2, control_period=0.05, mixture=mixture)
    options = {"mixture_index": np.array([0, 1])}
    expected = ["not_reported", "ok"]
    assert env.reset(seed=0, options=options)[1]["solver_status"].tolist() == expected
    assert env.step(env.action_space.sample())[4]["solver_status"].tolist() == expected
