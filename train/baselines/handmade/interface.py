"""What all hand-made controllers have in common."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from integ_gym.envs.settings import Setup

from ...policy.arrays import ActionArray
from ..interface import Baseline

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

P = TypeVar("P", bound="DataclassInstance")


class HandMade(Baseline, Generic[P]):
    """A controller that is designed from a plant's own parameters, for one task.

    Args:
        setup: of the environment.
    """

    policy_id = "handmade"
    plant_class: ClassVar[type[Any]]
    """Class of the plant that the task has; the module is named as the task's."""

    def __init__(self, setup: Setup) -> None:
        assert isinstance(setup.plant, self.plant_class)
        self.plant: P = setup.plant
        self.limit = float(setup.task.control_limit)
        self.period = setup.timing.control_period

    def parameters(self) -> dict[str, Any]:
        """The plant, the limit of the control and the control period."""
        return {"plant": asdict(self.plant), "limit": self.limit, "period": self.period}

    def act(self, observations: NDArray[Any]) -> ActionArray:
        """Actions of a `Box` space.

        Args:
            observations: shape (n, obs_dim), SI units.

        Returns:
            The controls, float32 of shape (n, 1).
        """
        controls = self.control(np.asarray(observations, dtype=np.float64))
        return controls.astype(np.float32)[:, None]

    def control(self, observations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Controls in N or N m, shape (n,), of observations of shape (n, obs_dim)."""
        raise NotImplementedError

    def saturated(self, control: NDArray[np.float64]) -> NDArray[np.float64]:
        """Controls within the limit."""
        within: NDArray[np.float64] = np.clip(control, -self.limit, self.limit)
        return within
