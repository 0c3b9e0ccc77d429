"""A model of stable-baselines3 while it is trained, as a policy."""

from __future__ import annotations

from typing import Any


class RawModel:
    """A model as it is now, asked with raw observations.

    Args:
        model: of stable-baselines3, with the `VecNormalize` that it was trained with, if any.

    Raises:
        ValueError: for one that remembers earlier observations, which is asked one by one here.
    """

    def __init__(self, model: Any) -> None:
        if hasattr(model.policy, "lstm_actor"):
            raise ValueError(
                f"{type(model).__name__} remembers earlier observations, and is not judged; train "
                "a feed-forward policy, or give a function that keeps no memory"
            )
        self._model = model

    def predict(self, observations: Any, deterministic: bool = True) -> Any:
        """Actions of the model for a batch."""
        normalize = self._model.get_vec_normalize_env()
        seen = observations if normalize is None else normalize.normalize_obs(observations)
        return self._model.predict(seen, deterministic=deterministic)
