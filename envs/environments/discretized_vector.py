"""What a vector environment tells of itself, beside what Gymnasium asks."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, VectorEnv

from ..episode import Mixture


class DiscretizedVectorEnv(VectorEnv[Any, Any, Any]):
    """A vector environment of which evidence can be recorded.

    Attributes:
        mixture: the discretizations that its lanes run on; one where it is no mixture.
        setups: what the lanes are made of: the mixture's.
        autoreset_mode: when a lane that has ended is reset.
    """

    mixture: Mixture
    setups: tuple[Any, ...]
    autoreset_mode: AutoresetMode

    @property
    def state(self) -> npt.NDArray[np.float64]:
        """True states in the order of the setup's plant, SI units, shape (num_envs, n)."""
        return np.stack(self.state_components, axis=1)

    @property
    def state_components(self) -> Any:
        """The same component by component, each of shape (num_envs,)."""
        raise NotImplementedError

    @property
    def status_codes(self) -> npt.NDArray[np.int64]:
        """The solver's status in every lane's last step, as a code of `STATUS_NAMES`; read-only.

        Of a lane that was reset in place of a step, that of the reset.
        """
        raise NotImplementedError

    @property
    def final_state(self) -> npt.NDArray[np.float64]:
        """With ``SAME_STEP``, true states before the last step's resets, shape (num_envs, n)."""
        raise NotImplementedError
