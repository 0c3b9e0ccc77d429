"""Random and zero for any space of actions."""

from __future__ import annotations

import numpy as np
import pytest
from gymnasium import spaces

from integ_gym.train.baselines import RandomPolicy, ZeroPolicy

BOX = spaces.Box(np.array([-1.0, 0.5, -3.0], np.float32), np.array([2.0, 1.0, 3.0], np.float32))
OBSERVATIONS = np.random.default_rng(0).normal(size=(4000, 5))


def _made(space: spaces.Box, seed: int = 0) -> dict:
    return {"random": RandomPolicy(space, seed), "zero": ZeroPolicy(space)}


@pytest.mark.parametrize("name", ["random", "zero"])
def test_actions_are_of_the_space_and_depend_on_the_observation_alone(name: str) -> None:
    policy = _made(BOX)[name]
    actions = policy.act(OBSERVATIONS)
    assert actions.shape == (4000, 3)
    assert all(BOX.contains(action) for action in actions[:100])
    one_by_one = np.concatenate([policy.act(row[None]) for row in OBSERVATIONS[:10]])
    np.testing.assert_array_equal(one_by_one, actions[:10])


def test_random_is_uniform_in_every_component_and_between_them() -> None:
    actions = _made(BOX)["random"].act(OBSERVATIONS)
    share = (actions - BOX.low) / (BOX.high - BOX.low)
    np.testing.assert_allclose(share.mean(axis=0), 0.5, atol=0.02)
    np.testing.assert_allclose(share.std(axis=0), 12.0**-0.5, atol=0.01)
    assert np.abs(np.corrcoef(share.T) - np.eye(3)).max() < 0.06


def test_zero_is_zero_or_the_nearest_bound() -> None:
    np.testing.assert_array_equal(_made(BOX)["zero"].act(OBSERVATIONS[:2]), [[0.0, 0.5, 0.0]] * 2)


def test_the_hash_covers_seed_and_bounds() -> None:
    other = spaces.Box(BOX.low, 2.0 * BOX.high)
    made = [_made(BOX), _made(BOX, 1), _made(other)]
    assert len({one["random"].content_hash for one in made}) == 3
    assert made[0]["zero"].content_hash == made[1]["zero"].content_hash


@pytest.mark.parametrize(
    "space",
    [
        spaces.MultiBinary(2),
        spaces.Box(-np.inf, np.inf, (1,), np.float32),
    ],
)
@pytest.mark.parametrize("policy", [RandomPolicy, ZeroPolicy])
def test_another_space_is_refused(policy: type, space: spaces.Space) -> None:
    with pytest.raises(ValueError, match="a Discrete set or a bounded Box of actions, got"):
        policy(space)


@pytest.mark.parametrize("limit", [0.8, 2.0, 1e-3, 123.4567])
def test_bounds_mean_the_decimal_number_that_they_were_given_as(limit: float) -> None:
    """A space holds float32; actions are scaled by the number itself."""
    random = RandomPolicy(spaces.Box(-limit, limit, (1,), np.float32))
    assert random.parameters() == {"seed": 0, "actions": None, "limit": limit}
