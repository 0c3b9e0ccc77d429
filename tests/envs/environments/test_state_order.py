"""The order of states: the same in all that users give and are given, whatever is inside."""

import gymnasium as gym
import jax
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from integ_gym.envs import functional
from integ_gym.envs.numerics.stepping import probe_state
from integ_gym.envs.ops.ops import SCALAR, split_state
from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.envs.rendering.renderer import Renderer
from integ_gym.envs.testbeds.boundaries import IntegBoundaries
from integ_gym.eval.film import play_episode
from integ_gym.train.baselines import make_baseline

ACROBOTS = ("IntegAcrobot-v0", "IntegAcrobotSwingUp-v0")


def vector(env_id, lanes=2, mode=AutoresetMode.NEXT_STEP, **arguments):
    return gym.make_vec(
        env_id, lanes, vectorization_mode="vector_entry_point", autoreset_mode=mode.value,
        **arguments,
    ).unwrapped  # fmt: skip


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_a_state_is_in_one_order_wherever_it_is_given(env_id):
    env = gym.make(env_id, duration=0.4, render_mode="rgb_array").unwrapped
    inner = probe_state(env.setup.plant)
    assert len(set(inner)) > 2 or len(inner) == 2
    given = np.concatenate([inner[0::2], inner[1::2]]) if env_id in ACROBOTS else inner
    seen, _ = env.reset(seed=0, options={"state": given})
    np.testing.assert_array_equal(env.state, given)
    np.testing.assert_array_equal(env.state_components, inner)
    expected = env.setup.task.observe(SCALAR, *split_state(tuple(inner.tolist())))
    np.testing.assert_allclose(seen, expected, rtol=1e-6)
    picture = Renderer(env.setup, "rgb_array", 20).draw(inner, env._idle, 0.0)
    np.testing.assert_array_equal(env.render(), picture)

    modes = AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP
    many, other = (vector(env_id, 2, x, duration=0.4, render_mode="rgb_array") for x in modes)
    for envs in (many, other):
        envs.reset(seed=0, options={"state": np.array([given, given])})
        np.testing.assert_array_equal(envs.state, [given, given])
        np.testing.assert_array_equal(envs.render()[1], picture)
    is_over = np.zeros(2, bool)
    while not is_over.any():
        for envs in (many, other):
            _, _, terminated, truncated, _ = envs.step(envs.action_space.sample() * 0)
        is_over = terminated | truncated
    np.testing.assert_array_equal(many.final_state[is_over], other.state[is_over])

    pure = functional.make(env_id)
    start = pure.initial_from(given, jax.random.key(0))
    np.testing.assert_allclose(pure.observation(start), expected, rtol=1e-5, atol=1e-6)
    named = IntegBoundaries(vector(env_id)).observation(
        np.concatenate([inner[0::2], inner[1::2]]), seed=0
    )
    np.testing.assert_allclose([*named.values()], expected, rtol=1e-6)
    episode = play_episode(make_baseline("zero", env.setup), env_id, {"duration": 0.4}, 0, inner)
    np.testing.assert_array_equal(episode.states[0], inner)


@pytest.mark.parametrize("env_id", ACROBOTS)
def test_a_refused_state_is_shown_as_it_was_given(env_id):
    env = gym.make(env_id, max_speed_1=1.0)
    with pytest.raises(ValueError, match=r"got \(0.0, 5.0, 2.0, 0.0\)"):
        env.reset(options={"state": (0.0, 5.0, 2.0, 0.0)})
    with pytest.raises(ValueError, match=r"\(theta_1, theta_2, theta_1_dot, theta_2_dot\)"):
        env.reset(options={"state": (0.0, 5.0)})


def _run(envs, seed):
    """Episodes of two decisions each, whose starts have to be slow enough."""
    envs.reset(seed=seed)
    for _ in range(200):
        assert np.abs(envs.state[:, 2]).max() <= 0.08
        envs.step(np.zeros((4, 1), np.float32))


def test_starts_that_are_too_fast_are_refused_at_every_reset():
    """Also where they are drawn ahead for many lanes."""
    limits = {"max_speed_1": 0.08, "duration": 0.04}
    envs = vector("IntegAcrobotSwingUp-v0", 4, AutoresetMode.SAME_STEP, **limits)
    with pytest.raises(ValueError, match="speeds up to"):
        _run(envs, seed=2)
