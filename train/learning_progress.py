"""What stable-baselines3 (SB3) tells while it learns: a bar, and the last episodes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from integ_gym.train.card import episode_summary, told
from integ_gym.train.side_by_side import training_bar


class LearningProgress:
    """SB3's callback: a bar over the decisions taken, with return and success of the last episodes.

    Args:
        total: decisions of the whole run.
        shown: whether there is a bar at all.
        on_steps: told the decisions of each advance.
    """

    def __init__(self, total: int, shown: bool, on_steps: Callable[[int], None]) -> None:
        self._on_steps = on_steps
        self._done = 0
        self._bar = training_bar(total, 1, shown)
        self._episode_ended = False

    def __enter__(self) -> LearningProgress:
        return self

    def __exit__(self, *exception: object) -> None:
        self._bar.close()

    def __call__(self, variables: dict[str, Any], _: dict[str, Any]) -> bool:
        """Called by SB3 after every step of the environments; True goes on."""
        model = variables["self"]
        if self._episode_ended:  # SB3 counts the episodes of a step after this call
            self._bar.set_postfix_str(told(last_episodes(model)), refresh=False)
        advanced = model.num_timesteps - self._done
        self._done = model.num_timesteps
        self._bar.update(advanced)
        self._on_steps(advanced)
        self._episode_ended = bool(variables["dones"].any())
        return True


def last_episodes(model: Any) -> dict[str, Any]:
    """The last (up to 100) episodes of training."""
    returns = [float(episode["r"]) for episode in model.ep_info_buffer]
    return episode_summary(returns, [float(success) for success in model.ep_success_buffer])
