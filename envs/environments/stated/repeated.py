"""A decision that holds for several steps of an environment."""

from __future__ import annotations

from typing import Any, Final, Literal, cast

import gymnasium as gym
from gymnasium import wrappers

from integ_gym.support.parameters import unknown_name

from ..foreign import wrappers_of

Rewards = Literal["rate", "sum", "last"]

REWARDS: Final = ("rate", "sum", "last")
"""What the rewards of an environment's steps may be; see :class:`Repeated`."""

_COUNTS = (
    "counts steps, of which a finer `dt` has more; put it around what `held` returns, where a step "
    "is a decision"
)
_LEARNS = (
    "keeps statistics of all steps so far, so that an episode depends on those before it; give "
    "fixed numbers to a TransformObservation or TransformReward"
)
_REFUSED: Final = {
    wrappers.AtariPreprocessing: _COUNTS,
    wrappers.Autoreset: "starts the next episode by itself; leave it out",
    wrappers.DelayObservation: _COUNTS,
    wrappers.FrameStackObservation: _COUNTS,
    wrappers.MaxAndSkipObservation: _COUNTS,
    wrappers.NormalizeObservation: _LEARNS,
    wrappers.NormalizeReward: _LEARNS,
    wrappers.RepeatAction: _COUNTS,
    wrappers.StickyAction: _COUNTS,
    wrappers.TimeAwareObservation: _COUNTS,
}
"""Wrappers that would mean something else at another step: why, and what helps."""


class Repeated(gym.Wrapper[Any, Any, Any, Any], gym.utils.RecordConstructorArgs):
    """Each action is applied for ``count`` steps, so that a finer step has the same decisions.

    What a decision pays depends on what the rewards of the steps are:

    - ``"rate"``: reward per unit of time, the same whatever the step is, as -1 for every step on
      the way. A decision pays their mean.
    - ``"sum"``: amounts, such as a cost that is scaled by the step or a bonus for an event. A
      decision pays their sum.
    - ``"last"``: a value of the state that is reached. A decision pays that of its last step.

    In each, the reward of the step that ends the episode counts whole.

    Args:
        env: whose step is one integration step.
        count: steps of a decision.
        rewards: what its rewards are; None: nobody said, and they are taken for rates.

    Attributes:
        rewards_assumed: whether nobody said what the rewards are.

    Raises:
        ValueError: for other rewards.
    """

    def __init__(self, env: gym.Env[Any, Any], count: int, rewards: Rewards | None = None) -> None:
        if rewards is not None and rewards not in REWARDS:
            raise ValueError(unknown_name("meaning of rewards", rewards, REWARDS))
        gym.utils.RecordConstructorArgs.__init__(self, count=count, rewards=rewards)
        super().__init__(env)
        self.count = count
        self.rewards: Rewards = rewards or "rate"
        self.rewards_assumed = rewards is None

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Advance one decision, or until the episode ends."""
        earned, ended = 0.0, False
        for _ in range(self.count):
            observation, reward, terminated, truncated, info = self.env.step(action)
            last, ended = float(reward), bool(terminated or truncated)
            if ended:
                break
            earned += last
        if self.rewards == "last":
            earned = last
        elif self.rewards == "sum":
            earned += last if ended else 0.0
        else:
            earned = earned / self.count + (last if ended else 0.0)
        return observation, earned, terminated, truncated, info


def without_time_limit(env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
    """An environment without its `TimeLimit`, all other wrappers kept; it is changed.

    Raises:
        ValueError: for a wrapper that would mean something else at another step, by its name.
    """
    chain = list(wrappers_of(env))
    for one in chain:
        for kind, reason in _REFUSED.items():
            if isinstance(one, kind):
                name = type(one).__name__
                raise ValueError(f"`held` cannot keep the wrapper {name}: it {reason}")
    kept = [one for one in chain if not isinstance(one, wrappers.TimeLimit)]
    inner = chain[-1].env if chain else env
    for one in reversed(kept):
        one.env = inner
        inner = cast("gym.Env[Any, Any]", one)
    return inner
