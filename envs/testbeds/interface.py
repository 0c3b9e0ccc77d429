"""What a testbed is: a task that can be made in any discretization."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from ..sequential_vector import DiscretizedVectorEnv
from ..settings import Discretization, whole_multiple

REFINEMENTS = (1, 2, 4)
"""Parts of a home's coarsest step that are evaluated where no steps are given."""


@dataclass(frozen=True)
class Applied:
    """What a made environment really does, read back from it.

    Attributes:
        discretization: engine, integrator, step and control period.
        substeps: integration steps in a control period.
    """

    discretization: Discretization
    substeps: int


@dataclass(frozen=True)
class Success:
    """What success is.

    Attributes:
        goal: in words, with numbers and units.
        parameter: the argument that sets another goal, or None.
        suggested: a value for it that is known from elsewhere, or None.
    """

    goal: str
    parameter: str | None = None
    suggested: float | None = None


class Testbed(Hashable, Protocol):
    """A task with fixed arguments, in any of the discretizations that it offers.

    Built from an environment id and the arguments that all discretizations have in common; a
    user's own, ``"module:Class"``, from the arguments alone. Nothing is checked before something
    is asked for.

    Attributes:
        arguments: those arguments.
        batched: whether lanes advance together, so that many cost little more than one.
        home: the discretization that the task has by itself.
        control_period: the only one that it can have, s; None: any that ``dt`` divides.
        horizon: name of the argument that sets how long an episode lasts, s; None where that
            cannot be set.
        success: what success is.
        controller: name of its hand-made controller among the baselines, or ``"module:Class"``;
            None: none is known.
    """

    @property
    def arguments(self) -> Mapping[str, Any]: ...

    @property
    def batched(self) -> bool: ...

    @property
    def home(self) -> Discretization: ...

    @property
    def control_period(self) -> float | None: ...

    @property
    def horizon(self) -> str | None: ...

    @property
    def success(self) -> Success: ...

    @property
    def controller(self) -> str | None: ...

    def integrators(self, engine: str) -> tuple[str, ...]:
        """Names of the integrators that it offers on an engine, the truth's left out."""

    def steps(self, home: Discretization) -> tuple[float, ...]:
        """Steps, s, to evaluate a policy of that home at, where none are chosen."""

    def truth(self, control_period: float) -> Discretization | None:
        """The discretization that solves the plant to rounding; None where there is none."""

    def make(
        self, discretization: Discretization, lanes: int, **arguments: Any
    ) -> DiscretizedVectorEnv:
        """A vector environment in a discretization.

        Args:
            discretization: one that it offers.
            lanes: number of environments.
            arguments: that differ from the testbed's, and ``autoreset_mode``.

        Raises:
            TypeError, ValueError: for what cannot be made.
        """

    def applied(self, environments: DiscretizedVectorEnv) -> Applied:
        """What the environments that it made really do."""


def split_period(testbed: Testbed, discretization: Discretization) -> tuple[float, int]:
    """The control period asked for, s, else the testbed's own; and its integration steps.

    Raises:
        ValueError: for a step that does not divide it.
    """
    asked = discretization.control_period
    period = testbed.control_period if asked is None else asked
    return period, whole_multiple("control_period", period, "dt", discretization.dt)
