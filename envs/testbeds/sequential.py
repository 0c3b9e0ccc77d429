"""What testbeds have in common whose environments are stepped one after the other."""

from __future__ import annotations

from functools import partial
from typing import Any

import gymnasium as gym
from gymnasium.vector import AutoresetMode

from integ_gym.support.parameters import unknown_name

from ..environments.discretized_vector import DiscretizedVectorEnv
from ..environments.sequential_vector import SequentialVectorEnv
from ..episode.discretization import Discretization
from .interface import REFINEMENTS


class SequentialTestbed:
    """A testbed of one control period, its home's, and without a truth.

    Args:
        arguments: that all discretizations have in common.
    """

    batched = False
    horizon = None
    controller = None
    home: Any
    """A `Discretization`."""
    title: str
    """What messages call it."""

    def __init__(self, arguments: dict[str, Any]) -> None:
        self.arguments = arguments
        self.title = type(self).__name__

    @property
    def engine(self) -> str:
        """The only one that it has."""
        return str(self.home.engine)

    @property
    def control_period(self) -> float:
        """The home's."""
        return float(self.home.control_period)

    def steps(self, home: Discretization) -> tuple[float, ...]:
        """The home's, half and a quarter of it."""
        return tuple(home.dt / parts for parts in REFINEMENTS)

    def truth(self, control_period: float) -> None:
        """None: what would solve it to rounding is not known."""
        return

    def lane(self, discretization: Discretization, arguments: dict[str, Any]) -> gym.Env[Any, Any]:
        """One environment, a :class:`~integ_gym.envs.environments.sequential_vector.Lane`.

        Args:
            discretization: on this engine.
            arguments: all of its arguments.
        """
        raise NotImplementedError

    def make(
        self,
        discretization: Discretization,
        lanes: int,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **arguments: Any,
    ) -> DiscretizedVectorEnv:
        """One environment per lane.

        Raises:
            TypeError, ValueError: for a discretization that it cannot have.
        """
        if discretization.engine != self.engine:
            kind = f"engine of {self.title}"
            raise ValueError(unknown_name(kind, discretization.engine, [self.engine]))
        make = partial(self.lane, discretization, {**self.arguments, **arguments})
        return SequentialVectorEnv(make, lanes, autoreset_mode)
