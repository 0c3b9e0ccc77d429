"""Environments that are stepped one after the other, as a vector."""

from __future__ import annotations

from collections.abc import Callable
from math import nan
from typing import Any, Protocol, cast

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from ..episode.mixture import Mixture
from .discretized_vector import DiscretizedVectorEnv

_PERHAPS_UNKNOWN = (
    *("energy", "actuator_work", "dissipated", "clip_loss", "energy_residual"),
    *("solver_iterations", "solver_residual"),
)


class Lane(Protocol):
    """What an environment tells beside what Gymnasium asks, to be one of such a vector.

    Attributes:
        setup: timing, names and units, for evidence.
        state_components: the true state, SI units.
        final_state: the same, before the last reset.
        status_code: the solver's status in the last control step.
        final_status: the same, before the last reset.
        fresh: whether no step has been taken since the last reset.
    """

    setup: Any
    state_components: tuple[float, ...]
    final_state: tuple[float, ...]
    status_code: int
    final_status: int
    fresh: bool


class SequentialVectorEnv(SyncVectorEnv[Any, Any], DiscretizedVectorEnv):
    """Environments of one kind, advanced one after the other.

    What one leaves out of ``info`` because it is not known is NaN here, and masked.

    Args:
        make: makes one of them, which is a :class:`Lane`.
        num_envs: how many.
        autoreset_mode: an `AutoresetMode` or its value.
    """

    def __init__(
        self,
        make: Callable[[], gym.Env[Any, Any]],
        num_envs: int,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    ) -> None:
        super().__init__([make] * num_envs, autoreset_mode=autoreset_mode)
        self._tasks = cast("list[Lane]", self.envs)
        self.spec = self.envs[0].spec
        self.mixture = Mixture((self._tasks[0].setup,))
        self.setups = self.mixture.setups
        self.setup = self.setups[0]

    @property
    def state(self) -> npt.NDArray[np.float64]:
        """See :class:`DiscretizedVectorEnv`; shape (num_envs, 0) where the state is not known."""
        return np.array([task.state_components for task in self._tasks])

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
        missing = [n for n in _PERHAPS_UNKNOWN if "time" in env_info and n not in env_info]
        infos = super()._add_info(vector_infos, env_info | dict.fromkeys(missing, nan), env_num)
        for name in missing:
            infos[f"_{name}"][env_num] = False
        return infos
