"""Baseline controllers: the protocol that all keep, and linear-quadratic design known by hand."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from playing import (
    ACROBOT,
    ACROBOT_UP,
    CART_POLE,
    ELASTIC,
    HOPPER,
    PENDULUM,
    QUADROTOR,
    REACHER,
    SWING_UP,
    TIGHT,
    play,
    setup_of,
)

import integ_gym
from integ_gym.envs.registries import TASKS
from integ_gym.envs.transition import control_columns
from integ_gym.train.baselines import (
    BASELINES,
    HANDMADE,
    RandomPolicy,
    ZeroPolicy,
    has_handmade,
    make_baseline,
    possible_baselines,
)
from integ_gym.train.controllers import linearize, lqr_gain
from integ_gym.train.policy import Policy


@dataclass(frozen=True)
class Idle:
    """A task that nobody has a controller for."""


@pytest.mark.parametrize("env_id", integ_gym.ENVIRONMENTS)
def test_protocol(env_id):
    env = gym.make(env_id)
    setup = env.unwrapped.setup
    size, discrete = len(setup.task.observation_names), setup.task.discrete is not None
    observations = np.random.default_rng(0).normal(size=(6, size)).astype(np.float32)
    for name in possible_baselines(setup):
        policy = make_baseline(name, setup)
        assert isinstance(policy, Policy)
        assert policy.policy_id == name
        actions = policy.act(observations)
        assert policy.act(observations[:0]).shape[0] == 0
        if not discrete or name != "zero":
            assert actions.dtype == (np.int64 if discrete else np.float32)
            assert actions.shape == (6, *env.action_space.shape)
            assert all(action in env.action_space for action in actions)
    own = [name for name in HANDMADE.names() if isinstance(setup.task, TASKS.load(name))]
    assert has_handmade(setup) is bool(own) is ("handmade" in possible_baselines(setup))
    for name in own:
        assert type(make_baseline("handmade", setup)) is HANDMADE.load(name)
    other = replace(setup, task=Idle())
    assert not has_handmade(other)
    with pytest.raises(ValueError, match="there is no hand-made controller for the task Idle"):
        make_baseline("handmade", other)


@pytest.mark.parametrize("env_id", [e for e in integ_gym.ENVIRONMENTS if has_handmade(setup_of(e))])
def test_content_hash_covers_what_decides_the_actions(env_id):
    def hash_of(name, seed=0, **arguments):
        return make_baseline(name, setup_of(env_id, **arguments), seed=seed).content_hash

    limits = {PENDULUM: "max_torque", CART_POLE: "force_mag", QUADROTOR: "max_thrust"}
    limits |= {ACROBOT: "torque", ACROBOT_UP: "max_torque", REACHER: "target_limit"}
    limit = limits.get(env_id, "max_force")
    hashes = {hash_of(name) for name in BASELINES}
    assert len(hashes) == len(BASELINES)
    changes: list[dict[str, Any]] = [{limit: 1.5}, {"damping": 0.2}]
    links = env_id in (ACROBOT, ACROBOT_UP, REACHER)
    changes += [{"gravity": 9.0}, {"control_period": 0.4 if links else 0.1}]
    changes += [{"mass_1" if links else "mass": 2.0}]
    changes += {
        ELASTIC: [{"stiffness": 50.0}, {"length": 2.0}],
        **{name: [{"length_2": 1.5}, {"mass_2": 2.0}] for name in (ACROBOT, ACROBOT_UP)},
        REACHER: [{"length_2": 0.4}, {"mass_2": 2.0}, {"servo_stiffness": 50.0}],
        HOPPER: [{"leg_stiffness": 1e3}, {"max_torque": 9.0}, {"target_speed": 0.5}],
        QUADROTOR: [{"arm": 0.3}, {"inertia": 0.01}, {"motor_time_constant": None}],
    }.get(env_id, [{"mass_distribution": "point"}, {"length": 2.0}])
    assert len({hash_of("handmade", **change) for change in changes} | hashes) == 3 + len(changes)
    assert hash_of("random", seed=1) not in hashes
    assert hash_of("handmade", integrator="explicit_euler") in hashes
    refused = {
        REACHER: ({"actuator": "effort"}, "gives targets, and `actuator`='effort' takes none")
    }
    given, words = refused.get(
        env_id, ({"gravity": 0.0}, "without gravity there is nothing to bal")
    )
    with pytest.raises(ValueError, match=words):
        hash_of("handmade", **given)


def test_refusals():
    with pytest.raises(ValueError, match=r"unknown baseline 'hand-made'\. Did you mean 'handmade'"):
        make_baseline("hand-made", setup_of(PENDULUM))
    envs = gym.make_vec(PENDULUM, 2, mass=np.array([1.0, 1.1]))
    with pytest.raises(ValueError, match="mass has one value per lane; make one baseline per"):
        make_baseline("handmade", envs.unwrapped.setup)
    for space in (spaces.MultiBinary(2), spaces.Box(-np.inf, np.inf, (1,), np.float32)):
        for policy in (RandomPolicy, ZeroPolicy):
            with pytest.raises(ValueError, match="a Discrete set or a bounded Box of actions, got"):
                policy(space)


def test_random_is_uniform_and_has_no_memory():
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
    choices = make_baseline("random", setup_of(CART_POLE)).act(
        np.random.default_rng(0).normal(size=(n, 4)).astype(np.float32)
    )
    assert set(choices) == {0, 1}
    assert abs(choices.mean() - 0.5) < 4.0 * 0.5 / math.sqrt(n)


BOX = spaces.Box(np.array([-1.0, 0.5, -3.0], np.float32), np.array([2.0, 1.0, 3.0], np.float32))


def test_actions_of_several_components_depend_on_the_observation_alone():
    observations = np.random.default_rng(0).normal(size=(4000, 5))
    random, zero = RandomPolicy(BOX, 0), ZeroPolicy(BOX)
    for policy in (random, zero):
        actions = policy.act(observations)
        assert actions.shape == (4000, 3)
        assert all(BOX.contains(action) for action in actions[:100])
        one_by_one = np.concatenate([policy.act(row[None]) for row in observations[:10]])
        np.testing.assert_array_equal(one_by_one, actions[:10])
    np.testing.assert_array_equal(zero.act(observations[:2]), [[0.0, 0.5, 0.0]] * 2)
    share = (random.act(observations) - BOX.low) / (BOX.high - BOX.low)
    np.testing.assert_allclose(share.mean(axis=0), 0.5, atol=0.02)
    np.testing.assert_allclose(share.std(axis=0), 12.0**-0.5, atol=0.01)
    assert np.abs(np.corrcoef(share.T) - np.eye(3)).max() < 0.06
    others = [RandomPolicy(BOX, 1), RandomPolicy(spaces.Box(BOX.low, 2.0 * BOX.high), 0)]
    assert len({one.content_hash for one in (random, *others)}) == 3
    for limit in (0.8, 1e-3, 123.4567):  # and not the space's float32
        policy = RandomPolicy(spaces.Box(-limit, limit, (1,), np.float32))
        assert policy.parameters() == {"seed": 0, "actions": None, "limit": limit}


@pytest.mark.parametrize("fallback", ["hold", "zero"])
@pytest.mark.parametrize("env_id", integ_gym.ENVIRONMENTS)
def test_zero_never_acts(env_id, fallback):
    latency = 0.04 if fallback == "hold" else 0.0
    arguments = {"integrator": "rk4", "dt": 0.02, "action_latency": latency, "fallback": fallback}
    arguments |= {"actuator": "effort"} if env_id == REACHER else {}  # zero is a target, too
    env = gym.make(env_id, **arguments)
    setup = env.unwrapped.setup
    policy, columns = make_baseline("zero", setup), list(control_columns(setup.plant))
    observation, _ = env.reset(seed=0)
    for _ in range(20):
        action = policy.act(observation[None])[0]
        observation, _, terminated, _, info = env.step(action)
        assert {info[applied] for _, applied in columns} == {0.0}
        assert info["fallback_used"] is True or env_id != CART_POLE
        assert info["actuator_work"] == 0.0
        if terminated:
            observation, _ = env.reset()


@pytest.mark.parametrize("name", ["random", "zero"])
def test_no_skill_does_not_succeed(name):
    assert play(PENDULUM, name, 20, **(TIGHT | {"integrator": "rk4"})).success == 0.0
    for env_id in (CART_POLE, SWING_UP, ELASTIC, QUADROTOR, REACHER, HOPPER):
        assert play(env_id, name, 10, integrator="rk4").success == 0.0


def test_linearization_of_the_pendulum_and_the_cart_pole():
    """Against M q̈ = G q + F solved by hand: M = [[m+M, ml], [ml, I]], G = diag(0, mgl)."""
    close = {"rtol": 1e-8, "atol": 1e-8}
    plant = setup_of(PENDULUM, mass=2.0, length=0.5, damping=0.3).plant
    a, b = linearize(plant)
    drag = -0.3 / plant.inertia
    np.testing.assert_allclose(a, [[0.0, 1.0], [1.5 * 10.0 / 0.5, drag]], **close)
    np.testing.assert_allclose(b, [[0.0], [1.0 / plant.inertia]], **close)
    mass_matrix = np.array([[1.1, 0.05], [0.05, 4.0 / 3.0 * 0.1 * 0.25]])
    stiffness = np.linalg.solve(mass_matrix, np.diag([0.0, 0.1 * 9.8 * 0.5]))
    push = np.linalg.solve(mass_matrix, [1.0, 0.0])
    a, b = linearize(setup_of(CART_POLE).plant)
    np.testing.assert_allclose(a[[1, 3]][:, [0, 2]], stiffness, **close)
    np.testing.assert_allclose(a[[0, 2]], [[0, 1, 0, 0], [0, 0, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(b.ravel(), [0.0, push[0], 0.0, push[1]], **close)


def test_lqr_gain_of_a_scalar_system_and_of_one_that_cannot_be_held():
    """x ← x + u with Q = R = 1: P is the golden ratio, K = P / (1 + P)."""
    golden, one = (1.0 + math.sqrt(5.0)) / 2.0, np.eye(1)
    np.testing.assert_allclose(lqr_gain(one, one, one, one), [[golden / (1.0 + golden)]])
    with pytest.raises(ValueError, match="no linear control holds this plant upright"):
        lqr_gain(2.0 * one, np.zeros((1, 1)), one, one)
