"""Rediscretized tasks side by side."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from ...episode import Mixture
from ..discretized_vector import DiscretizedVectorEnv
from .environment import RediscretizedEnv


class RediscretizedVectorEnv(SyncVectorEnv[Any, Any], DiscretizedVectorEnv):
    """Rediscretized tasks of one kind, advanced one after the other.

    Args:
        make: makes one of them.
        num_envs: how many.
        autoreset_mode: an `AutoresetMode` or its value.
    """

    def __init__(
        self,
        make: Callable[[], RediscretizedEnv],
        num_envs: int,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    ) -> None:
        super().__init__([make] * num_envs, autoreset_mode=autoreset_mode)
        self._tasks = cast("list[RediscretizedEnv]", self.envs)
        self.spec = self._tasks[0].spec
        self.mixture = Mixture((cast("Any", self._tasks[0].setup),))
        self.setups = self.mixture.setups
        self.setup = self.setups[0]

    @property
    def state_components(self) -> npt.NDArray[np.float64]:
        """See :class:`DiscretizedVectorEnv`."""
        return np.array([task.state_components for task in self._tasks]).T

    @property
    def status_codes(self) -> npt.NDArray[np.int64]:  # type: ignore[override]
        """See :class:`DiscretizedVectorEnv`."""
        same_step = self.autoreset_mode is AutoresetMode.SAME_STEP
        return np.array(
            [
                task.final_status if same_step and task.fresh else task.status_code
                for task in self._tasks
            ]
        )

    @property
    def final_state(self) -> npt.NDArray[np.float64]:  # type: ignore[override]
        """See :class:`DiscretizedVectorEnv`."""
        return np.array([task.final_state for task in self._tasks])
