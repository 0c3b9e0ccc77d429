"""What a vector environment tells of itself, beside what Gymnasium asks."""

from __future__ import annotations

from collections.abc import Callable
from math import nan
from typing import Any, Protocol, cast

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv

from .settings import Mixture


class DiscretizedVectorEnv(VectorEnv[Any, Any, Any]):
    """A vector environment of which evidence can be recorded.

    Attributes:
        mixture: the discretizations that its lanes run on; one where it is no mixture.
        setups: what the lanes are made of: the mixture's.
        autoreset_mode: when a lane that has ended is reset.
        state_components: :attr:`state` component by component, each of shape (num_envs,); they hold
            until the next step.
        status_codes: the solver's status in every lane's last step, as a code of `STATUS_NAMES`;
            read-only. Of a lane that was reset in place of a step, that of the reset.
        final_state: with ``SAME_STEP``, true states before the last step's resets, shape
            (num_envs, n).
    """

    mixture: Mixture
    setups: tuple[Any, ...]
    autoreset_mode: AutoresetMode
    state_components: Any
    status_codes: npt.NDArray[np.int64]
    final_state: npt.NDArray[np.float64]

    @property
    def state(self) -> npt.NDArray[np.float64]:
        """True states in the order of the setup's plant, SI units, shape (num_envs, n)."""
        return np.stack(self.state_components, axis=1)


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
