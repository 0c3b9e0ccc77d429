"""Rediscretized tasks side by side."""

from __future__ import annotations

from collections.abc import Callable
from math import nan
from typing import Any, cast

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from ...episode import Mixture
from ..discretized_vector import DiscretizedVectorEnv
from .environment import RediscretizedEnv

_PERHAPS_UNKNOWN = ("dissipated", "energy_residual")


class RediscretizedVectorEnv(SyncVectorEnv[Any, Any], DiscretizedVectorEnv):
    """Rediscretized tasks of one kind, advanced one after the other.

    What a task leaves out of ``info`` because it is not known is NaN here, and masked.

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

    def _add_info(
        self, vector_infos: dict[str, Any], env_info: dict[str, Any], env_num: int
    ) -> dict[str, Any]:
        """What Gymnasium's does; what is not known is no 0."""
        missing = [n for n in _PERHAPS_UNKNOWN if "energy" in env_info and n not in env_info]
        infos = super()._add_info(vector_infos, env_info | dict.fromkeys(missing, nan), env_num)
        for name in missing:
            infos[f"_{name}"][env_num] = False
        return infos
