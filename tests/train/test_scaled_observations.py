"""A model that learned inside VecNormalize is told from one that did not, and not judged silently.

Nothing of a file is executed for it.
"""

import base64
import json
import os
import pickle
from contextlib import suppress

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import TransformObservation
from hypothesis import given, settings
from hypothesis import strategies as st
from policy_files import refusal, rewritten, setting
from stable_baselines3 import DQN, PPO, SAC
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import integ_gym
from integ_gym.eval.panel.doubts import _doubt_scaling
from integ_gym.eval.panel.policies import read_existing
from integ_gym.train.policy_files import card as limits
from integ_gym.train.policy_files.card import PolicyFileError
from integ_gym.train.policy_files.pickles import StandIn, read_vec_normalize
from integ_gym.train.policy_files.reading import unscaled
from integ_gym.train.policy_files.sb3_zip import read_observation_statistics, read_sb3_zip
from integ_gym.train.policy_files.sidecar import read_trained
from integ_gym.train.policy_files.writing import save_policy, write_sidecar

PENDULUM, HOME = "IntegPendulum-v0", "stock"
SMALL = {
    PPO: {"n_steps": 16, "batch_size": 16, "n_epochs": 1},
    SAC: {"learning_starts": 100, "buffer_size": 50},
    DQN: {"learning_starts": 100, "buffer_size": 50},
}


def _environment(dtype, discrete):
    env = gym.make("CartPole-v1" if discrete else "Pendulum-v1")
    seen = env.observation_space
    space = gym.spaces.Box(seen.low.astype(dtype), seen.high.astype(dtype), dtype=np.dtype(dtype))
    return TransformObservation(env, lambda observation: observation.astype(dtype), space)


def _trained(algorithm, scale, folder, dtype="float32"):
    """A model, saved as `policy.zip` with its `vecnormalize.pkl`.

    Args:
        algorithm: its class.
        scale: `norm_obs` of its `VecNormalize`; None: without one.
        folder: for the files.
        dtype: of the environment's observations.
    """
    env = DummyVecEnv([lambda: _environment(dtype, algorithm is DQN)])
    if scale is not None:
        env = VecNormalize(env, norm_obs=scale)
        env.save(folder / "vecnormalize.pkl")
    model = algorithm("MlpPolicy", env, seed=0, device="cpu", **SMALL[algorithm])
    model.learn(16)
    model.save(folder / "policy.zip")
    return model


@pytest.mark.parametrize(
    ("algorithm", "scale", "dtype", "found"),
    [
        (PPO, None, "float32", False),
        (PPO, True, "float32", True),
        (PPO, False, "float32", True),  # of which its vecnormalize.pkl can say that it is not
        (PPO, None, "float64", False),
        (PPO, True, "float64", True),
        (SAC, True, "float32", False),  # which does not show
        (SAC, False, "float64", False),
        (DQN, True, "float64", True),
    ],
)
def test_what_a_file_shows_of_scaling(algorithm, scale, dtype, found, tmp_path):
    _trained(algorithm, scale, tmp_path, dtype)
    assert unscaled(tmp_path / "policy.zip") == found


class _Bomb:
    def __reduce__(self):
        return os.mkdir, ("run",)


def _pickled(value):
    return {":type:": "x", ":serialized:": base64.b64encode(pickle.dumps(value)).decode()}


@pytest.mark.parametrize(
    "seen",
    [3, {}, {":serialized:": "é"}, {":serialized:": "gAR9"}, _pickled(_Bomb()), _pickled([1.0])],
)
def test_what_was_seen_last_is_never_executed(seen, pendulum_zip, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = rewritten(pendulum_zip, tmp_path / "x.zip", setting("_last_original_obs", to=seen))
    assert unscaled(path)
    assert not (tmp_path / "run").exists()


def test_without_statistics_no_side_car_and_no_copy_is_written(tmp_path):
    model = _trained(PPO, True, tmp_path)
    policy, statistics = tmp_path / "policy.zip", tmp_path / "vecnormalize.pkl"
    with pytest.raises(PolicyFileError, match=r'pass obs_stats="vecnormalize\.pkl"'):
        write_sidecar(policy, PENDULUM, home=HOME)
    copy = tmp_path / "copy.safetensors"
    with pytest.raises(PolicyFileError, match=r'pass obs_stats="vecnormalize\.pkl"'):
        save_policy(policy, copy, PENDULUM, home=HOME)
    with pytest.raises(PolicyFileError, match=r"load it with env=VecNormalize\.load"):
        save_policy(PPO.load(policy), copy, PENDULUM, home=HOME)
    assert {path.name for path in tmp_path.iterdir()} == {policy.name, statistics.name}
    save_policy(model, copy, PENDULUM, home=HOME)
    save_policy(policy, copy, PENDULUM, home=HOME, obs_stats=statistics)
    write_sidecar(policy, PENDULUM, home=HOME, obs_stats=statistics)
    assert not unscaled(policy, read_trained(policy)[1])
    save_policy(policy, tmp_path / "again.safetensors", PENDULUM, home=HOME)


@pytest.mark.slow
def test_an_evaluation_without_statistics_says_so(tmp_path):
    _trained(PPO, True, tmp_path)
    policy, statistics = tmp_path / "policy.zip", tmp_path / "vecnormalize.pkl"
    said: list[str] = []
    integ_gym.evaluate(
        PPO.load(policy), PENDULUM, tmp_path / "out", home=HOME, integrators=["rk4"], dts=[0.05],
        episodes=2, environment={"duration": 0.5}, workers=1, progress=False, on_doubt=said.append,
    )  # fmt: skip
    (doubt,) = [one for one in said if "trained inside VecNormalize" in one]
    assert "load it with env=VecNormalize.load(path, venv)" in doubt
    assert json.loads((tmp_path / "out" / "panel.json").read_text("utf-8"))["doubts"] == said
    assert doubt[:40] in (tmp_path / "out" / "report.html").read_text("utf-8")
    (doubt,) = _doubt_scaling(read_existing(policy, PENDULUM, {}))
    assert "pass --obs-stats vecnormalize.pkl" in doubt
    assert not read_existing(policy, PENDULUM, {}, statistics).unscaled
    _trained(PPO, False, tmp_path)
    assert not read_existing(policy, PENDULUM, {}, statistics).unscaled
    write_sidecar(policy, PENDULUM, home=HOME, obs_stats=statistics)
    assert not unscaled(policy, read_trained(policy)[1])


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
