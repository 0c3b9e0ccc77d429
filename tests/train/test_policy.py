"""Policies in NumPy: what they do, refuse and are identified by."""

from __future__ import annotations

import itertools
import os
import pickle
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import given, settings
from hypothesis import strategies as st
from pairing import in_turn

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.train.baselines import make_baseline, possible_baselines
from integ_gym.train.fleet.learning import initial_stack
from integ_gym.train.policy import (
    ACTIVATIONS,
    BoxActions,
    DiscreteActions,
    MlpPolicy,
    ObservationStatistics,
    PolicyStack,
)


def layers(*sizes, seed=0):
    rng = np.random.default_rng(seed)
    return tuple(
        (rng.normal(size=(after, before)), rng.normal(size=after))
        for before, after in pairwise(sizes)
    )


BOX_ACTIONS = BoxActions(np.array([-1.0, 0.0]), np.array([1.0, 3.0]))
BOX_POLICY = MlpPolicy(layers(3, 5, 2), "Tanh", BOX_ACTIONS, policy_id="box")
DISCRETE_POLICY = MlpPolicy(layers(4, 6, 3), "ReLU", DiscreteActions(3), policy_id="discrete")
STATISTICS = ObservationStatistics(np.zeros(3), np.ones(3), epsilon=1e-8, clip_obs=10.0)

SIMPLE = MlpPolicy(
    ((np.array([[1.0, -2.0]]), np.array([0.5])),),
    "Tanh",
    BoxActions(np.array([-2.0]), np.array([2.0])),
)
SIMPLE_HASH = "95fb6ac8dc8ea1ea00856fe626fdb9e78f4aa97ff099e75fccaa80b262397d60"


@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(0, 9),
    scale=st.floats(0, 10) | st.floats(0, 1e30),
    squash=st.booleans(),
)
@settings(deadline=None, max_examples=40)
def test_rows_are_independent_and_within_bounds(seed, n, scale, squash):
    policy = replace(BOX_POLICY, actions=replace(BOX_ACTIONS, squash=squash))
    observations = np.random.default_rng(seed).normal(size=(n, 3)) * scale
    actions = policy.act(observations)
    assert actions.shape == (n, 2)
    assert actions.dtype == np.float32
    assert (actions >= BOX_ACTIONS.low).all()
    assert (actions <= BOX_ACTIONS.high).all()
    if scale <= 10.0:
        alone = [policy.act(observation[None])[0] for observation in observations]
        np.testing.assert_allclose(np.reshape(alone, (n, 2)), actions, rtol=0, atol=1e-4)


def test_discrete_actions_are_the_first_largest_output():
    tie = np.array([[0.0, 1.0, 1.0], [2.0, 1.0, 2.0]], dtype=np.float32)
    choice = DiscreteActions(3).decode(tie)
    assert choice.dtype == np.int64
    np.testing.assert_array_equal(choice, [1, 0])
    assert DISCRETE_POLICY.act(np.zeros((0, 4))).shape == (0,)


def test_a_nan_observation_gives_a_nan_action_in_its_row_only():
    observations = np.zeros((2, 3))
    observations[1, 0] = np.nan
    np.testing.assert_array_equal(
        np.isnan(BOX_POLICY.act(observations)), [[False, False], [True, True]]
    )
    with pytest.raises(ValueError, match="gives NaN, so no discrete action can be chosen; give"):
        DISCRETE_POLICY.act(np.full((1, 4), np.nan))


@pytest.mark.parametrize("shape", [(3,), (1, 4), (2, 2, 3)])
def test_observations_of_another_shape_are_refused(shape):
    with pytest.raises(ValueError) as caught:
        BOX_POLICY.act(np.zeros(shape))
    assert f"expected observations of shape (n, 3), got {shape}; pass a" in str(caught.value)
    rows = np.arange(6.0).reshape(2, 1, 3)
    np.testing.assert_array_equal(BOX_POLICY.act(rows), BOX_POLICY.act(rows[:, 0]))


def test_content_hash_is_fixed_across_versions_and_processes():
    assert SIMPLE.content_hash == SIMPLE_HASH
    code = (
        "import sys; sys.modules['torch'] = None; import numpy as np\n"
        "from integ_gym.train.policy import BoxActions, MlpPolicy\n"
        "layer = (np.array([[1.0, -2.0]]), np.array([0.5]))\n"
        "actions = BoxActions(np.array([-2.0]), np.array([2.0]))\n"
        "print(MlpPolicy((layer,), 'Tanh', actions).content_hash)"
    )
    printed = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "PYTHONHASHSEED": "77"},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert printed.strip() == SIMPLE_HASH


def test_content_hash_covers_all_that_decides_the_action():
    nudged = ((SIMPLE.layers[0][0] + np.float32(1e-6), SIMPLE.layers[0][1]),)
    shifted = ((SIMPLE.layers[0][0], np.array([0.5000001])),)
    two = ObservationStatistics(np.zeros(2), np.ones(2), epsilon=1e-8, clip_obs=10.0)
    others = [
        replace(SIMPLE, activation="ReLU"),
        replace(SIMPLE, layers=nudged),
        replace(SIMPLE, layers=shifted),
        replace(SIMPLE, actions=DiscreteActions(1)),
        replace(SIMPLE, actions=replace(SIMPLE.actions, squash=True)),
        replace(SIMPLE, actions=replace(SIMPLE.actions, high=np.array([3.0]))),
        replace(SIMPLE, statistics=two),
        replace(SIMPLE, statistics=replace(two, mean=np.array([0.0, 1e-9]))),
        replace(SIMPLE, statistics=replace(two, var=np.array([1.0, 2.0]))),
        replace(SIMPLE, statistics=replace(two, epsilon=1e-7)),
        replace(SIMPLE, statistics=replace(two, clip_obs=9.0)),
    ]
    hashes = {policy.content_hash for policy in [SIMPLE, *others]}
    assert len(hashes) == 1 + len(others)


def test_content_hash_leaves_the_name_and_the_float_width_of_the_input_out():
    assert replace(BOX_POLICY, policy_id="other").content_hash == BOX_POLICY.content_hash
    narrow = tuple((w.astype(np.float32), b.astype(np.float32)) for w, b in layers(3, 5, 2))
    assert replace(BOX_POLICY, layers=narrow).content_hash == BOX_POLICY.content_hash
    assert pickle.loads(pickle.dumps(BOX_POLICY)).content_hash == BOX_POLICY.content_hash


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: replace(BOX_POLICY, activation="Sine"), "'Sine' is not known; use one of ELU, "),
        (lambda: replace(BOX_POLICY, layers=()), "a policy needs at least one layer, got none"),
        (
            lambda: replace(BOX_POLICY, layers=(*layers(3, 5), *layers(4, 2))),
            "layer 1 has a weight of shape (2, 4) and a bias of shape (2,) after 5 inputs; exp",
        ),
        (
            lambda: replace(BOX_POLICY, layers=((np.zeros((2, 3)), np.zeros(1)),)),
            "layer 0 has a weight of shape (2, 3) and a bias of shape (1,) after 3 inputs",
        ),
        (
            lambda: replace(BOX_POLICY, layers=((np.full((2, 3), np.inf), np.zeros(2)),)),
            "layer 0 has weights that are not finite, so training diverged; train again",
        ),
        (
            lambda: replace(BOX_POLICY, layers=layers(3, 5, 3)),
            "the last layer has 3 outputs and the action space Box([-1.0, 0.0], [1.0, 3.0]) needs",
        ),
        (
            lambda: replace(DISCRETE_POLICY, statistics=STATISTICS),
            "statistics have shape (3,) and the policy takes observations of shape (4,); use the",
        ),
        (lambda: replace(BOX_ACTIONS, high=np.ones(3)), "of one shape, got (2,) and (3,)"),
        (
            lambda: replace(BOX_ACTIONS, high=np.full(2, np.nan)),
            "must be finite and 'low' not above",
        ),
        (lambda: DiscreteActions(0), "needs at least one action, got 0"),
        (lambda: replace(STATISTICS, mean=np.full(3, np.nan)), "must hold finite numbers only"),
    ],
)
def test_parts_that_do_not_fit_are_refused(make, reason):
    with pytest.raises(ValueError) as caught:
        make()
    assert reason in str(caught.value)


def test_spaces_fit_whatever_their_bounds_or_are_refused():
    of_three, of_four = (spaces.Box(-9.0, 9.0, (size,)) for size in (3, 4))
    BOX_POLICY.check_spaces(of_three, spaces.Box(-7.0, 7.0, (2,)))
    DISCRETE_POLICY.check_spaces(of_four, spaces.Discrete(3, dtype=np.int32))
    for policy, seen, taken, reason in (
        (BOX_POLICY, of_four, BOX_ACTIONS.space, "'box' expects observations of shape (3,) and"),
        (BOX_POLICY, spaces.Discrete(3), BOX_ACTIONS.space, "the environment gives Discrete(3); "),
        (BOX_POLICY, of_three, spaces.Box(-1.0, 1.0, (1,)), "gives actions for Box of shape (2,)"),
        (DISCRETE_POLICY, of_four, spaces.Discrete(2), "and the environment takes Discrete(2); "),
        (DISCRETE_POLICY, of_four, spaces.Discrete(3, start=1), "takes Discrete(3, start=1); "),
        (DISCRETE_POLICY, of_four, of_three, "takes Box of shape (3,); "),
    ):
        with pytest.raises(ValueError) as caught:
            policy.check_spaces(seen, taken)
        assert reason in str(caught.value)
        assert str(caught.value).endswith("trained in, or train one here")


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


@pytest.mark.parametrize(("activation", "n"), in_turn(ACTIVATIONS, (1, 3, 20, 50)))
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
    expected = np.array(_each(policies, observations))
    np.testing.assert_array_equal(PolicyStack(policies).act(observations), expected)
    asked = np.zeros((len(policies), 20), dtype=bool)
    asked[1:5, 3:7] = asked[0, 19] = True
    given = PolicyStack(policies, batched=False).act(observations, asked)
    np.testing.assert_allclose(given[asked], expected[asked], atol=1e-6)  # batches round otherwise
    assert not given[1:5, :3].any()


class Counting:
    """Its action is how often it was asked since an episode began."""

    def begin(self):
        asked = itertools.count(1)
        return lambda observations: np.full((len(observations), 1), float(next(asked)))


def test_a_policy_that_remembers_is_not_asked_about_a_lane_that_rests():
    stack, seen = PolicyStack([Counting()], batched=False), _observations(1, 2)
    told = [
        stack.act(seen, np.array([asked], bool))[0, :, 0].tolist()
        for asked in ([1, 1], [0, 1], [1, 1])
    ]
    assert told == [[1.0, 1.0], [0.0, 2.0], [2.0, 3.0]]


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_baselines_act_as_alone(env_id):
    setup = environment_setup(env_id, {})
    policies = [make_baseline(name, setup) for name in possible_baselines(setup)]
    observations = _observations(len(policies), 20, len(setup.task.observation_names))
    expected = _each(policies, observations)
    np.testing.assert_array_equal(PolicyStack(policies).act(observations), expected)
