"""Observations that come late, with their timestamp, in every form of an environment."""

from __future__ import annotations

from collections import deque

import gymnasium as gym
import numpy as np
import pytest

import integ_gym

COMMON = {"integrator": "rk4", "dt": 0.0125, "control_period": 0.05, "duration": 1.5}
LATENCIES = [0.05, 0.075, 0.1125]


class Late(gym.Wrapper):
    """Steps one that decides at every integration step, and shows what was so long ago."""

    def __init__(self, env, substeps, late):
        super().__init__(env)
        self.substeps, self.late = substeps, late

    def reset(self, **given):
        observation, info = self.env.reset(**given)
        self.seen = deque([observation] * (self.late + 1), self.late + 1)
        return observation, info

    def step(self, action):
        for _ in range(self.substeps):
            observation, _, _, truncated, info = self.env.step(action)
            self.seen.append(observation)
        return self.seen[0], 0.0, False, truncated, info


def _actions(steps):
    return np.random.default_rng(0).uniform(-2.0, 2.0, (steps, 1)).astype(np.float32)


@pytest.mark.parametrize("latency", LATENCIES)
def test_observations_are_those_of_an_independent_wrapper(latency):
    env = gym.make("IntegPendulum-v0", **COMMON, observation_latency=latency)
    fine = gym.make("IntegPendulum-v0", **{**COMMON, "control_period": 0.0125})
    wrapped = Late(fine, 4, round(latency / 0.0125))
    assert (env.reset(seed=3)[0] == wrapped.reset(seed=3)[0]).all()
    for k, action in enumerate(_actions(25)):
        own, _, _, _, info = env.step(action)
        assert (own == wrapped.step(action)[0]).all()
        assert info["sensor_time"] == pytest.approx(max(0.0, (k + 1) * 0.05 - latency))


@pytest.mark.parametrize(
    ("latency", "sensor_period", "noise"),
    [(0.05, 0.0375, 0.01), (0.1, 0.0875, 0.0), (0.075, None, 0.0), (0.1125, None, 0.01)],
)
def test_single_vector_and_compiled_are_the_same(latency, sensor_period, noise):
    given = {
        **COMMON, "observation_latency": latency, "sensor_period": sensor_period,
        "observation_noise": noise,
    }  # fmt: skip
    single = gym.make("IntegCartPoleSwingUp-v0", **given)
    kinds = [{}] if noise else [{}, {"compiled": True}]
    vectors = [gym.make_vec("IntegCartPoleSwingUp-v0", 3, **given, **kind) for kind in kinds]
    first, _ = single.reset(seed=5)
    for vector in vectors:
        assert (vector.reset(seed=[4, 5, 6])[0][1] == first).all()
    for action in 3.0 * _actions(28):
        own, reward, *_, info = single.step(action)
        for vector in vectors:
            observation, rewards, *_, infos = vector.step(np.repeat(action[None], 3, axis=0))
            assert (observation[1] == own).all()
            assert rewards[1] == reward
            assert infos["sensor_time"][1] == info["sensor_time"]


def test_the_functional_environment_is_the_same():
    import jax

    given = {**COMMON, "observation_latency": 0.075}
    with jax.enable_x64(True):
        env = integ_gym.functional.make("IntegPendulum-v0", dtype="float64", **given)
        single = gym.make("IntegPendulum-v0", **given)
        single.reset(seed=2)
        state = env.initial_from(single.unwrapped.state, jax.random.key(0))
        step = jax.jit(env.transition)
        for k, action in enumerate(_actions(20)):
            own = single.step(action)[0]
            state = step(state, action, jax.random.key(k))
            np.testing.assert_allclose(env.observation(state, None), own, rtol=1e-6, atol=1e-6)


def test_the_newest_sample_that_can_have_arrived_is_shown():
    """With a sensor that samples more seldom than decisions are taken, too."""
    env = gym.make("IntegPendulum-v0", **COMMON, observation_latency=0.1, sensor_period=0.0875)
    env.reset(seed=0)
    for k in range(20):
        *_, info = env.step(np.zeros(1, np.float32))
        newest = np.floor(((k + 1) * 0.05 - 0.1) / 0.0875 + 1e-9) * 0.0875
        assert info["sensor_time"] == pytest.approx(max(0.0, newest))


def test_what_is_no_multiple_is_refused():
    with pytest.raises(ValueError, match=r"observation_latency.*nearest valid: 0\.0125 or 0\.025"):
        gym.make("IntegPendulum-v0", **COMMON, observation_latency=0.02)
    with pytest.raises(ValueError, match=r"sensor_period.*nearest valid: 0\.05 or 0\.1"):
        gym.make("IntegPendulum-v0", **COMMON, observation_latency=0.075, sensor_period=0.025)


def test_the_truth_takes_a_step_that_divides_the_latency(tmp_path):
    panel = integ_gym.evaluate(
        lambda observation: [0.0], "IntegPendulum-v0", tmp_path,
        home={"integrator": "rk4", "dt": 0.05, "control_period": 0.05}, integrators=["rk4"],
        dts=[0.05], episodes=2, varied={"observation_latency": [0.02]}, at=["truth"], workers=1,
        environment={"duration": 1.0}, progress=False, on_doubt=lambda doubt: None,
    )  # fmt: skip
    (late,) = (cell for cell in panel.cells if "observation_latency" in cell.environment)
    assert late.applied.dt == 0.01
