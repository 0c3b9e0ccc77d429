"""A decision that holds for several steps of an environment."""

from __future__ import annotations

from typing import Any

import gymnasium as gym


class Repeated(gym.Wrapper[Any, Any, Any, Any], gym.utils.RecordConstructorArgs):
    """Each action is applied for ``count`` steps, so that a finer step has the same decisions.

    The reward is the mean of theirs: what an environment pays for a step, it pays for a decision.

    Args:
        env: whose step is one integration step.
        count: steps of a decision.
    """

    def __init__(self, env: gym.Env[Any, Any], count: int) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, count=count)
        super().__init__(env)
        self.count = count

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Advance one decision, or until the episode ends."""
        total = 0.0
        for _ in range(self.count):
            observation, reward, terminated, truncated, info = self.env.step(action)
            total += float(reward)
            if terminated or truncated:
                break
        return observation, total / self.count, terminated, truncated, info
