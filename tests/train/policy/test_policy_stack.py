"""Policies in a stack act as they do alone, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.train.baselines import BASELINES, make_baseline
from integ_gym.train.fleet.learning import initial_stack
from integ_gym.train.policy import (
    ACTIVATIONS,
    BoxActions,
    DiscreteActions,
    MlpPolicy,
    ObservationStatistics,
    PolicyStack,
)

BOX = BoxActions([-2.0], [2.0])


def _network(seed, sizes=(3, 64, 64), actions=BOX, activation="Tanh", statistics=None):
    stack = initial_stack([seed], sizes, actions.size, None)
    rng = np.random.default_rng(seed)
    layers = [
        (30.0 * weight[0, 0], rng.normal(0.0, 0.3, bias.shape[-1]))
        for weight, bias in zip(stack.weights, stack.biases, strict=True)
    ]
    return MlpPolicy(tuple(layers), activation, actions, statistics)


def _observations(policies, n, width=3):
    rng = np.random.default_rng(n)
    return rng.normal(0.0, 2.0, (policies, n, width)).astype(np.float32)


def _each(policies, observations):
    return [p.act(o).astype(np.float64) for p, o in zip(policies, observations, strict=True)]


@pytest.mark.parametrize("n", [1, 3, 20, 50])
@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_networks_act_as_alone_whoever_is_beside_them(activation, n):
    policies = [_network(seed, activation=activation) for seed in range(7)]
    observations = _observations(7, n)
    alone = _each(policies, observations)
    np.testing.assert_array_equal(PolicyStack(policies).act(observations), alone)
    some = [4, 2]
    part = PolicyStack([policies[place] for place in some]).act(observations[some])
    np.testing.assert_array_equal(part, [alone[place] for place in some])
    assert len(np.unique(alone)) > 1


@pytest.mark.parametrize("actions", [BOX, DiscreteActions(2)], ids=str)
def test_policies_of_all_kinds_act_together(actions):
    statistics = ObservationStatistics(np.ones(3), np.full(3, 2.0), 1e-8, 10.0)
    narrow = BoxActions([-0.5], [0.5]) if actions is BOX else actions
    policies = [
        _network(0, actions=actions),
        _network(1, (3, 16), actions),
        _network(2, actions=actions, statistics=statistics),
        _network(3, actions=narrow),
        _network(4, actions=actions, activation="ReLU"),
        _network(5, actions=actions),
    ]
    observations = _observations(len(policies), 20)
    expected = _each(policies, observations)
    np.testing.assert_array_equal(PolicyStack(policies).act(observations), expected)


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_baselines_act_as_alone(env_id):
    setup = environment_setup(env_id, {})
    policies = [make_baseline(name, setup) for name in BASELINES]
    observations = _observations(len(policies), 20, len(setup.task.observation_names))
    expected = _each(policies, observations)
    np.testing.assert_array_equal(PolicyStack(policies).act(observations), expected)
