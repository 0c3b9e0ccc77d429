"""`vecnormalize.pkl` is read as data: whatever it names, nothing is imported or called."""

from __future__ import annotations

import os
import pickle
from contextlib import suppress
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from integ_gym.train.policy_files.error import PolicyFileError
from integ_gym.train.policy_files.formats.sb3_zip.observation_statistics import (
    read_observation_statistics,
)
from integ_gym.train.policy_files.formats.vec_normalize.inert_pickle import (
    Note,
    entries,
    parse_pickle,
)
from integ_gym.train.policy_files.formats.vec_normalize.reading import read_vec_normalize


def _normalized(**arguments) -> VecNormalize:
    env = VecNormalize(DummyVecEnv([lambda: gym.make("Pendulum-v1")]), **arguments)
    env.obs_rms.update(np.random.default_rng(0).normal(2.0, 3.0, size=(100, 3)))
    return env


@pytest.fixture(scope="module")
def content(tmp_path_factory) -> bytes:
    path = tmp_path_factory.mktemp("saved") / "vecnormalize.pkl"
    _normalized(clip_obs=7.0, epsilon=1e-6).save(path)
    return path.read_bytes()


@pytest.mark.parametrize("protocol", range(2, pickle.HIGHEST_PROTOCOL + 1))
def test_statistics_are_those_that_were_saved(protocol):
    env = _normalized(clip_obs=7.0, epsilon=1e-6)
    read = read_vec_normalize(pickle.dumps(env, protocol=protocol))
    assert read is not None
    np.testing.assert_array_equal(read.mean, env.obs_rms.mean)
    np.testing.assert_array_equal(read.var, env.obs_rms.var)
    assert (read.epsilon, read.clip_obs) == (1e-6, 7.0)
    seen = np.random.default_rng(1).normal(size=(5, 3)).astype(np.float32)
    np.testing.assert_array_equal(read.normalize(seen), env.normalize_obs(seen))


def test_rewards_alone_may_be_normalized(tmp_path):
    path = tmp_path / "vecnormalize.pkl"
    _normalized(norm_obs=True).save(path)
    assert read_observation_statistics(path) is not None
    env = _normalized()
    env.norm_obs = False
    env.save(path)
    assert read_observation_statistics(path) is None


class _Evil:
    def __init__(self, *call) -> None:
        self._call = call

    def __reduce__(self):
        return self._call[0], tuple(self._call[1:])


@pytest.mark.parametrize("protocol", range(2, pickle.HIGHEST_PROTOCOL + 1))
def test_nothing_is_executed(protocol, tmp_path):
    target = tmp_path / "ran"
    for evil in (_Evil(os.mkdir, str(target)), {"obs_rms": _Evil(os.system, f"touch {target}")}):
        with pytest.raises(PolicyFileError, match="holds no VecNormalize"):
            read_vec_normalize(pickle.dumps(evil, protocol=protocol))
    env = _normalized()
    env.obs_rms.mean = _Evil(os.mkdir, str(target))
    with pytest.raises(PolicyFileError, match="no arrays of numbers"):
        read_vec_normalize(pickle.dumps(env, protocol=protocol))
    assert not target.exists()


@given(data=st.data())
@settings(deadline=None, max_examples=150)
def test_damage_is_refused_in_a_sentence(content, data):
    place = data.draw(st.integers(2, len(content) - 1))
    byte = data.draw(st.integers(0, 255))
    damaged = content[:place] + bytes([byte]) + content[place + 1 :]
    with suppress(ValueError):
        read_vec_normalize(damaged)
    with pytest.raises(ValueError):
        read_vec_normalize(content[:place])


def test_a_dictionary_of_observations_is_refused(tmp_path):
    env = _normalized()
    env.obs_rms = {"a": env.obs_rms}
    path = tmp_path / "vecnormalize.pkl"
    path.write_bytes(pickle.dumps(env))
    with pytest.raises(PolicyFileError, match="those of a dictionary are not read; give the file"):
        read_observation_statistics(Path(path))


def test_shared_tuples_take_no_time():
    """Each of 60 tuples holds the one before twice: walked through, that would never end."""
    levels = b"".join(b"q%ch%c\x86" % (k, k) for k in range(60))
    assert entries(Note(None, (), [parse_pickle(b"\x80\x02)" + levels + b".")])) == {}
