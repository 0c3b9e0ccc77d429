"""What every policy offers to an evaluation."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from numpy.typing import NDArray

from .arrays import ActionArray


@runtime_checkable
class Policy(Protocol):
    """What acts in an evaluation: the mean (or argmax) action, never a sampled one."""

    @property
    def policy_id(self) -> str:
        """Name that people read in tables."""

    @property
    def content_hash(self) -> str:
        """Hex digest of everything that decides the actions, the same in every process."""

    def act(self, observations: NDArray[Any]) -> ActionArray:
        """Actions for a batch of observations.

        Args:
            observations: shape (n, obs_dim), in the environment's units.

        Returns:
            float32 of shape (n, action_dim) within the bounds for a `Box` action space, in the
            environment's units; int64 of shape (n,) for a `Discrete` one.
        """
