"""Policies in NumPy: what they do, refuse and are identified by."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import given, settings
from hypothesis import strategies as st

from integ_gym.train.policy import (
    BoxActions,
    DiscreteActions,
    MlpPolicy,
    ObservationStatistics,
)

Layers = tuple[tuple[np.ndarray, np.ndarray], ...]


def layers(*sizes: int, seed: int = 0) -> Layers:
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
@settings(deadline=None)
def test_rows_are_independent_and_within_bounds(
    seed: int, n: int, scale: float, squash: bool
) -> None:
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


def test_discrete_actions_are_the_first_largest_output() -> None:
    tie = np.array([[0.0, 1.0, 1.0], [2.0, 1.0, 2.0]], dtype=np.float32)
    choice = DiscreteActions(3).decode(tie)
    assert choice.dtype == np.int64
    np.testing.assert_array_equal(choice, [1, 0])
    assert DISCRETE_POLICY.act(np.zeros((0, 4))).shape == (0,)


def test_a_nan_observation_gives_a_nan_action_in_its_row_only() -> None:
    observations = np.zeros((2, 3))
    observations[1, 0] = np.nan
    np.testing.assert_array_equal(
        np.isnan(BOX_POLICY.act(observations)), [[False, False], [True, True]]
    )
    with pytest.raises(ValueError, match="gives NaN, so no discrete action can be chosen; give"):
        DISCRETE_POLICY.act(np.full((1, 4), np.nan))


@pytest.mark.parametrize("shape", [(3,), (1, 4), (2, 2, 3)])
def test_observations_of_another_shape_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError) as caught:
        BOX_POLICY.act(np.zeros(shape))
    assert f"expected observations of shape (n, 3), got {shape}; pass a" in str(caught.value)
    rows = np.arange(6.0).reshape(2, 1, 3)
    np.testing.assert_array_equal(BOX_POLICY.act(rows), BOX_POLICY.act(rows[:, 0]))


def test_content_hash_is_fixed_across_versions_and_processes() -> None:
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


def test_content_hash_covers_all_that_decides_the_action() -> None:
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


def test_content_hash_leaves_the_name_and_the_float_width_of_the_input_out() -> None:
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
            lambda: replace(BOX_POLICY, layers=((np.zeros(3), np.zeros(())),)),
            "layer 0 has a weight of shape (3,)",
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
            lambda: replace(DISCRETE_POLICY, actions=DiscreteActions(2)),
            "the last layer has 3 outputs and the action space Discrete(2) needs 2",
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
def test_parts_that_do_not_fit_are_refused(make: Callable[[], object], reason: str) -> None:
    with pytest.raises(ValueError) as caught:
        make()
    assert reason in str(caught.value)


FITTING_BOX = spaces.Box(-9.0, 9.0, (3,))


def test_spaces_that_fit_are_accepted_whatever_their_bounds() -> None:
    BOX_POLICY.check_spaces(FITTING_BOX, spaces.Box(-7.0, 7.0, (2,)))
    DISCRETE_POLICY.check_spaces(
        spaces.Box(-np.inf, np.inf, (4,)), spaces.Discrete(3, dtype=np.int32)
    )


@pytest.mark.parametrize(
    ("policy", "observation_space", "action_space", "reason"),
    [
        (
            BOX_POLICY,
            spaces.Box(-1.0, 1.0, (4,)),
            BOX_ACTIONS.space,
            "policy 'box' expects observations of shape (3,) and the environment gives "
            "Box of shape (4,); evaluate it in",
        ),
        (BOX_POLICY, spaces.Discrete(3), BOX_ACTIONS.space, "the environment gives Discrete(3); "),
        (
            BOX_POLICY,
            FITTING_BOX,
            spaces.Box(-1.0, 1.0, (1,)),
            "policy 'box' gives actions for Box of shape (2,) and the environment takes "
            "Box of shape (1,); evaluate it in",
        ),
        (BOX_POLICY, FITTING_BOX, spaces.Discrete(2), "the environment takes Discrete(2); "),
        (
            DISCRETE_POLICY,
            spaces.Box(-1.0, 1.0, (4,)),
            spaces.Discrete(2),
            "policy 'discrete' gives actions for Discrete(3) and the environment takes Discrete(2)",
        ),
        (
            DISCRETE_POLICY,
            spaces.Box(-1.0, 1.0, (4,)),
            spaces.Discrete(3, start=1),
            "takes Discrete(3, start=1); ",
        ),
        (
            DISCRETE_POLICY,
            spaces.Box(-1.0, 1.0, (4,)),
            spaces.Box(-1.0, 1.0, (3,)),
            "takes Box of shape (3,); ",
        ),
    ],
)
def test_spaces_that_do_not_fit_are_refused(
    policy: MlpPolicy,
    observation_space: spaces.Space[Any],
    action_space: spaces.Space[Any],
    reason: str,
) -> None:
    with pytest.raises(ValueError) as caught:
        policy.check_spaces(observation_space, action_space)
    message = str(caught.value)
    assert reason in message
    assert message.endswith("trained in, or train one here")
    assert "\n" not in message
