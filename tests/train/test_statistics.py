"""Statistics of VecNormalize are read as data: nothing that a file names is imported or called."""

from __future__ import annotations

import json
import os
import pickle
from contextlib import suppress

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from policy_files import refusal
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from integ_gym.train.policy_files import card as limits
from integ_gym.train.policy_files.card import PolicyFileError
from integ_gym.train.policy_files.pickles import StandIn, read_vec_normalize
from integ_gym.train.policy_files.sb3_zip import read_observation_statistics, read_sb3_zip

PROTOCOLS = range(2, pickle.HIGHEST_PROTOCOL + 1)


def _normalized(**arguments):
    env = VecNormalize(DummyVecEnv([lambda: gym.make("Pendulum-v1")]), **arguments)
    env.obs_rms.update(np.random.default_rng(0).normal(2.0, 3.0, size=(100, 3)))
    return env


@pytest.fixture(scope="module")
def content(tmp_path_factory):
    path = tmp_path_factory.mktemp("saved") / "vecnormalize.pkl"
    _normalized(clip_obs=7.0, epsilon=1e-6).save(path)
    return path.read_bytes()


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_statistics_are_those_that_were_saved(protocol):
    env = _normalized(clip_obs=7.0, epsilon=1e-6)
    read = read_vec_normalize(pickle.dumps(env, protocol=protocol))
    assert read is not None
    np.testing.assert_array_equal(read.mean, env.obs_rms.mean)
    np.testing.assert_array_equal(read.var, env.obs_rms.var)
    assert (read.epsilon, read.clip_obs) == (1e-6, 7.0)
    seen = np.random.default_rng(1).normal(size=(5, 3)).astype(np.float32)
    np.testing.assert_array_equal(read.normalize(seen), env.normalize_obs(seen))


def test_rewards_alone_may_be_normalized_and_a_dictionary_may_not(tmp_path):
    path, env = tmp_path / "vecnormalize.pkl", _normalized()
    env.save(path)
    assert read_observation_statistics(path) is not None
    env.norm_obs = False
    env.save(path)
    assert read_observation_statistics(path) is None
    env.norm_obs, env.obs_rms = True, {"a": env.obs_rms}
    env.save(path)
    with pytest.raises(PolicyFileError, match="those of a dictionary are not read; give the file"):
        read_observation_statistics(path)


class _Evil:
    def __init__(self, *call):
        self._call = call

    def __reduce__(self):
        return self._call[0], tuple(self._call[1:])


@pytest.mark.parametrize("protocol", PROTOCOLS)
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
    "a key too deep to hash": b"\x80\x02})" + b"\x85" * 300_000 + b"K\x01s.",
}


@pytest.mark.parametrize("content", ATTACKS.values(), ids=ATTACKS)
def test_attacks_are_refused_at_once(content):
    before = dict(StandIn.__dict__)
    with pytest.raises(PolicyFileError):
        read_vec_normalize(content)
    assert dict(StandIn.__dict__) == before


@given(data=st.data())
@settings(deadline=None, max_examples=60)
def test_damage_is_refused_in_a_sentence(content, data):
    place = data.draw(st.integers(2, len(content) - 1))
    byte = data.draw(st.integers(0, 255))
    damaged = content[:place] + bytes([byte]) + content[place + 1 :]
    with suppress(ValueError):
        read_vec_normalize(damaged)
    with pytest.raises(ValueError):
        read_vec_normalize(content[:place])


GOOD_STATISTICS = {"mean": [0.0, 1, -2.5], "var": [1.0, 0, 4.0], "epsilon": 1e-8, "clip_obs": 10}


def test_statistics_file_is_read(tmp_path):
    path = tmp_path / "statistics.json"
    path.write_text(json.dumps(GOOD_STATISTICS))
    statistics = read_observation_statistics(path)
    np.testing.assert_array_equal(statistics.mean, [0.0, 1.0, -2.5])
    np.testing.assert_array_equal(statistics.var, [1.0, 0.0, 4.0])
    assert (statistics.epsilon, statistics.clip_obs) == (1e-8, 10.0)
    normal = statistics.normalize(np.array([[0.5, 1.0, 97.5]], dtype=np.float32))
    np.testing.assert_allclose(normal, [[0.5, 0.0, 10.0]], rtol=1e-6)
    assert normal.dtype == np.float32


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("{", "the file is not readable JSON"),
        ("{}", "expected the keys mean, var and perhaps epsilon, clip_obs, got "),
        ({"count": 1}, "got clip_obs, count, epsilon, mean, var"),
        ({"mean": [0.0, "1", 2]}, "'mean' must be a list of finite numbers"),
        ({"mean": [True, False, True]}, "'mean' must be a list of finite numbers"),
        ({"mean": [0, 1, 10**400]}, "'mean' must be a list of finite numbers"),
        ({"var": [1.0, 2.0, float("inf")]}, "'var' must be a list of finite numbers"),
        ({"var": [1.0, 2.0]}, "of one length, got shapes (3,) and (2,)"),
        ({"var": [1.0, -2.0, 1.0]}, "'var' must hold no negative number, got -2.0"),
        ({"epsilon": 0}, "'epsilon' must be a finite number above 0, got 0"),
        ({"clip_obs": None}, "'clip_obs' must be a finite number, got None"),
    ],
)
def test_wrong_statistics_are_refused(content, reason, tmp_path, pendulum_zip):
    path = tmp_path / "statistics.json"
    text = content if isinstance(content, str) else json.dumps(GOOD_STATISTICS | content)
    path.write_text(text)
    for read in (read_observation_statistics, lambda p: read_sb3_zip(pendulum_zip, p)):
        with pytest.raises(PolicyFileError) as caught:
            read(path)
        assert str(caught.value).startswith(f"{path}: ")
        assert reason in str(caught.value)
        assert "write {" in str(caught.value)


def test_statistics_that_do_not_fit_or_cannot_be_read_are_refused(
    pendulum_zip, tmp_path, monkeypatch
):
    path = tmp_path / "statistics.json"
    with pytest.raises(PolicyFileError, match=r"cannot be opened \(No such file"):
        read_observation_statistics(path)
    path.write_text(json.dumps(GOOD_STATISTICS | {"mean": [0.0], "var": [1.0]}))
    message = refusal(pendulum_zip, path)
    assert "statistics have shape (1,) and the policy takes observations of shape (3,)" in message
    monkeypatch.setattr(limits, "MAX_JSON_BYTES", 10)
    with pytest.raises(PolicyFileError, match=r"has more than 10 bytes, which .*; give the file"):
        read_observation_statistics(path)
