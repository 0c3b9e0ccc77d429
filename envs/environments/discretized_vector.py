"""What a vector environment tells of itself, beside what Gymnasium asks."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, VectorEnv

from ..episode.mixture import Mixture


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
