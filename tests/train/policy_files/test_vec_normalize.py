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

from integ_gym.train.policy_files.card import PolicyFileError
from integ_gym.train.policy_files.pickles import StandIn, read_vec_normalize
from integ_gym.train.policy_files.sb3_zip import read_observation_statistics


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
    for evil in (
        _Evil(os.mkdir, str(target)),
        {"obs_rms": _Evil(os.system, f"touch {target}")},
        _Evil(eval, f"open({str(target)!r}, 'w')"),
        _Evil(getattr, "a text", "upper"),
    ):
        with pytest.raises(PolicyFileError, match=r"imports \w+\.\w+ when it is loaded"):
            read_vec_normalize(pickle.dumps(evil, protocol=protocol))
        env = _normalized()
        env.obs_rms.mean = evil
        with pytest.raises(PolicyFileError, match=r"imports \w+\.\w+ when it is loaded"):
            read_vec_normalize(pickle.dumps(env, protocol=protocol))
    assert not target.exists()


NUMPY = b"cnumpy\n"
ATTACKS = {
    "a function below a class": b"\x80\x04\x8c\x05numpy\x8c\x10ndarray.__class__\x93.",
    "a submodule by its dots": NUMPY + b"lib.npyio.os.system\n(S'true'\ntR.",
    "an old instance": b"(ios\nsystem\n.",
    "an object of a mark": b"(" + NUMPY + b"dtype\no.",
    "an extension": b"\x80\x02\x82\x01.",
    "numbers from elsewhere": b"\x80\x02K\x01Q.",
    "attributes of a class": NUMPY + b"dtype\n}S'name'\nK\x01sb.",
    "two states of a class": NUMPY + b"dtype\n(}}S'__new__'\nK\x01stb.",
    "a call of a text": b"S'system'\n(tR.",
    "memory for a queue": b"\x80\x05\x96\x00\x00\x00\x00\xff\x00\x00\x00.",
    "a memo without end": b"\x80\x02}r\xff\xff\xff\xff.",
    "a text without end": b"\x80\x04\x8d\xff\xff\xff\xff\xff\xff\xff\x7f.",
    "a frame without end": b"\x80\x04\x95\xff\xff\xff\xff\xff\xff\xff\x7f}.",
    "many tuples in one another": b"(" * 1_000_00 + b"t" * 1_000_00 + b".",
    "lists in one another": b"]" * 200_000 + b"a" * 199_999 + b".",
    "a key that takes for ever": b"\x80\x02})"
    + b"".join(b"q%ch%c\x86" % (k, k) for k in range(60))
    + b"K\x01s.",
    "keys that take for ever": b"\x80\x02}()"
    + b"".join(b"q%ch%c\x86" % (k, k) for k in range(60))
    + b"K\x01u.",
    "a set that takes for ever": b"\x80\x04\x8f()"
    + b"".join(b"q%ch%c\x86" % (k, k) for k in range(60))
    + b"\x90.",
    "a key too deep to hash": b"\x80\x02})" + b"\x85" * 1_000_000 + b"K\x01s.",
}


@pytest.mark.parametrize("content", ATTACKS.values(), ids=ATTACKS)
def test_attacks_are_refused_at_once(content):
    before = dict(StandIn.__dict__)
    with pytest.raises(PolicyFileError):
        read_vec_normalize(content)
    assert dict(StandIn.__dict__) == before


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
