"""Baseline controllers: the protocol that all keep, and what no skill reaches."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from dataclasses import dataclass, replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from playing import CART_POLE, ELASTIC, PENDULUM, SWING_UP, TIGHT, play, setup_of

import integ_gym
from integ_gym.envs.registries import TASKS
from integ_gym.train.baselines import BASELINES, HANDMADE, has_handmade, make_baseline
from integ_gym.train.policy import Policy

pytest.importorskip("scipy")


@dataclass(frozen=True)
class Idle:
    """A task that nobody has a controller for."""


@pytest.mark.parametrize("name", BASELINES)
@pytest.mark.parametrize("env_id", integ_gym.ENVIRONMENTS)
def test_protocol(env_id: str, name: str) -> None:
    env = gym.make(env_id)
    policy = make_baseline(name, env.unwrapped.setup)  # type: ignore[attr-defined]
    assert isinstance(policy, Policy)
    assert policy.policy_id == name
    assert len(policy.content_hash) == 64
    assert env.observation_space.shape is not None
    size = env.observation_space.shape[0]
    observations = np.random.default_rng(0).normal(size=(6, size)).astype(np.float32)
    actions = policy.act(observations)
    assert policy.act(observations[:0]).shape[0] == 0
    if env_id != CART_POLE:
        assert actions.dtype == np.float32
        assert actions.shape == (6, 1)
        assert all(action in env.action_space for action in actions)
    elif name != "zero":
        assert actions.dtype == np.int64
        assert actions.shape == (6,)
        assert all(action in env.action_space for action in actions)


@pytest.mark.parametrize("env_id", integ_gym.ENVIRONMENTS)
def test_which_tasks_have_a_hand_made_controller(env_id: str) -> None:
    setup = setup_of(env_id)
    assert has_handmade(setup)
    other = replace(setup, task=Idle())
    assert not has_handmade(other)
    with pytest.raises(ValueError, match="there is no hand-made controller for the task Idle"):
        make_baseline("handmade", other)


@pytest.mark.parametrize("env_id", integ_gym.ENVIRONMENTS)
def test_a_hand_made_controller_is_found_under_the_name_of_its_task(env_id: str) -> None:
    setup = setup_of(env_id)
    (name,) = (name for name in HANDMADE.names() if type(setup.task) is TASKS.load(name))
    assert type(make_baseline("handmade", setup)) is HANDMADE.load(name)
    assert set(HANDMADE.names()) <= set(TASKS.names())


@pytest.mark.parametrize("env_id", integ_gym.ENVIRONMENTS)
def test_content_hash_covers_what_decides_the_actions(env_id: str) -> None:
    def hash_of(name: str, seed: int = 0, **arguments: Any) -> str:
        return make_baseline(name, setup_of(env_id, **arguments), seed=seed).content_hash

    name = {PENDULUM: "max_torque", CART_POLE: "force_mag"}.get(env_id, "max_force")
    limit = {name: 1.5}
    hashes = {hash_of(name) for name in BASELINES}
    assert len(hashes) == len(BASELINES)
    changes: list[dict[str, Any]] = [limit, {"mass": 2.0}, {"damping": 0.1}, {"gravity": 9.0}]
    changes += [{"length": 2.0}, {"control_period": 0.1}]
    changes += [{"stiffness": 50.0}] if env_id == ELASTIC else [{"mass_distribution": "point"}]
    assert len({hash_of("handmade", **change) for change in changes} | hashes) == 3 + len(changes)
    assert hash_of("random", seed=1) not in hashes
    for integrator in ("explicit_euler", "reference"):
        assert hash_of("handmade", integrator=integrator) in hashes


def test_content_hash_is_the_same_in_every_process() -> None:
    code = (
        "import gymnasium as gym, integ_gym\n"
        "from integ_gym.train.baselines import BASELINES, make_baseline\n"
        "setup = gym.make('IntegPendulum-v0').unwrapped.setup\n"
        "print(*(make_baseline(name, setup).content_hash for name in BASELINES))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"PYTHONHASHSEED": "77"},
        capture_output=True,
        text=True,
        check=True,
    )
    setup = setup_of(PENDULUM)
    assert done.stdout.split() == [make_baseline(n, setup).content_hash for n in BASELINES]


@pytest.mark.parametrize(
    ("name", "arguments", "message"),
    [
        ("hand-made", {}, "unknown baseline 'hand-made'. Did you mean 'handmade'? Valid choices: "),
        ("handmade", {"gravity": 0.0}, "without gravity there is nothing to balance; leave"),
    ],
)
@pytest.mark.parametrize("env_id", integ_gym.ENVIRONMENTS)
def test_refusals(env_id: str, name: str, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError) as caught:
        make_baseline(name, setup_of(env_id, **arguments))
    assert message in str(caught.value)


def test_one_plant_per_baseline() -> None:
    envs = gym.make_vec(
        PENDULUM, 2, vectorization_mode="vector_entry_point", mass=np.array([1.0, 1.1])
    )
    with pytest.raises(ValueError, match="mass has one value per lane; make one baseline per"):
        make_baseline("handmade", envs.unwrapped.setup)  # type: ignore[attr-defined]


def test_random_is_uniform_and_has_no_memory() -> None:
    """Over a trajectory of neighbouring observations: uniform, and free of serial correlation."""
    n = 20_000
    angle = np.linspace(0.0, 0.5, n)
    observations = np.stack([np.cos(angle), np.sin(angle), angle], axis=1).astype(np.float32)
    policy = make_baseline("random", setup_of(PENDULUM, max_torque=3.0))
    actions = policy.act(observations)[:, 0]
    share_below = np.sort(actions / 6.0 + 0.5)
    assert np.abs(share_below - np.linspace(0.0, 1.0, n)).max() < 1.95 / math.sqrt(n)
    assert abs(np.corrcoef(actions[1:], actions[:-1])[0, 1]) < 4.0 / math.sqrt(n)
    assert abs(np.corrcoef(actions, angle)[0, 1]) < 4.0 / math.sqrt(n)
    order = np.random.default_rng(0).permutation(n)[:500]
    np.testing.assert_array_equal(policy.act(observations[order])[:, 0], actions[order])
    other = make_baseline("random", setup_of(PENDULUM, max_torque=3.0), seed=1)
    assert abs(np.corrcoef(other.act(observations)[:, 0], actions)[0, 1]) < 4.0 / math.sqrt(n)
    zeros = np.array([[0.0, 0.0, 0.0], [-0.0, 0.0, -0.0]])
    assert np.ptp(policy.act(zeros)) == 0.0


def test_random_choices_are_even() -> None:
    observations = np.random.default_rng(0).normal(size=(20_000, 4)).astype(np.float32)
    choices = make_baseline("random", setup_of(CART_POLE)).act(observations)
    assert set(choices) == {0, 1}
    assert abs(choices.mean() - 0.5) < 4.0 * 0.5 / math.sqrt(20_000)


@pytest.mark.parametrize("fallback", ["hold", "zero"])
@pytest.mark.parametrize("env_id", integ_gym.ENVIRONMENTS)
@pytest.mark.parametrize("latency", [0.0, 0.04])
def test_zero_never_acts(env_id: str, fallback: str, latency: float) -> None:
    arguments = {"integrator": "rk4", "dt": 0.02, "action_latency": latency, "fallback": fallback}
    env = gym.make(env_id, **arguments)
    policy = make_baseline("zero", env.unwrapped.setup)  # type: ignore[attr-defined]
    observation, _ = env.reset(seed=0)
    for _ in range(30):
        action = policy.act(observation[None])[0]
        observation, _, terminated, _, info = env.step(action)
        assert info["control"] == 0.0
        assert info["fallback_used"] is True or env_id != CART_POLE
        assert info["actuator_work"] == 0.0
        if terminated:
            observation, _ = env.reset()


@pytest.mark.parametrize("name", ["random", "zero"])
def test_no_skill_does_not_succeed(name: str) -> None:
    assert play(PENDULUM, name, 20, **(TIGHT | {"integrator": "rk4"})).success == 0.0
    for env_id in (CART_POLE, SWING_UP, ELASTIC):
        assert play(env_id, name, 20, integrator="rk4").success == 0.0
