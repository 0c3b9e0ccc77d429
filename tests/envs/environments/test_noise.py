"""Sensor noise and members of a mixture are drawn apart from starts, episode by episode."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

NOISY = {"observation_noise": 0.1, "integrator": "rk4"}
QUIET = {"observation_noise": 0.0, "integrator": "rk4"}
LENGTHS = ([1, 4, 2, 3], [3, 1, 5, 2])
"""Steps of episodes that follow each other, in two orders."""


def _single(**arguments):
    return gym.make("IntegPendulum-v0", **arguments)


def _vector(**arguments):
    return gym.make_vec("IntegPendulum-v0", 3, autoreset_mode="Disabled", **arguments)


def _episodes(env, lengths, seed=7):
    """Starts and observations of episodes after one seed."""
    starts, seen = [], []
    for index, length in enumerate(lengths):
        observation, _ = env.reset(seed=seed if index == 0 else None)
        starts.append(env.unwrapped.state.copy())
        observed = [observation]
        for _ in range(length):
            observed.append(env.step(np.zeros(env.action_space.shape))[0])
        seen.append(np.array(observed))
    return np.array(starts), seen


@pytest.mark.parametrize("make", [_single, _vector])
def test_starts_do_not_depend_on_noise_or_on_how_long_episodes_are(make):
    quiet, _ = _episodes(make(**QUIET), LENGTHS[0])
    for lengths in LENGTHS:
        starts, _ = _episodes(make(**NOISY), lengths)
        np.testing.assert_array_equal(starts, quiet)


def test_noise_can_be_drawn_again_without_the_episodes_before():
    env = _single(**NOISY)
    _, seen = _episodes(env, LENGTHS[0])
    assert not np.array_equal(seen[0][0], seen[1][0])
    for one, other in zip(seen, _episodes(_single(**NOISY), LENGTHS[1])[1], strict=True):
        shared = min(len(one), len(other))
        np.testing.assert_array_equal(one[:shared], other[:shared])
    again = _single(**NOISY)
    starts, _ = _episodes(_single(**QUIET), LENGTHS[0])
    first, _ = again.reset(seed=7, options={"state": starts[2], "episode": 2})
    np.testing.assert_array_equal(first, seen[2][0])
    np.testing.assert_array_equal(again.step(np.zeros(1))[0], seen[2][1])
    assert again.unwrapped.episode == 2
    for wrong in (-1, 0.5, "2"):
        with pytest.raises(ValueError, match="`episode` must be whole numbers from 0"):
            again.reset(options={"episode": wrong})


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_a_mixture_has_the_starts_of_a_single_discretization(noise):
    mixture = [{"integrator": "rk4"}, {"integrator": "explicit_euler"}]
    plain, _ = _episodes(_vector(**QUIET), LENGTHS[0])
    mixed = _vector(mixture=mixture, observation_noise=noise)
    starts, _ = _episodes(mixed, LENGTHS[1])
    np.testing.assert_array_equal(starts, plain)
    drawn = []
    for lengths in LENGTHS:
        env = _vector(mixture=mixture, observation_noise=noise)
        members = []
        for index, length in enumerate(lengths):
            members.append(env.reset(seed=7 if index == 0 else None)[1]["mixture_index"].tolist())
            for _ in range(length):
                env.step(np.zeros((3, 1)))
        drawn.append(members)
    assert drawn[0] == drawn[1]
