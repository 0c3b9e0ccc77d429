"""integ-gym's own environments as testbeds."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

from ..catalogue.lookup import environment_class, environment_setup
from ..environments.discretized_vector import DiscretizedVectorEnv
from ..episode.discretization import Discretization
from ..episode.timing import dividing_step
from ..registries import ENGINES, TRUTH
from .interface import REFINEMENTS, Applied, Success


class IntegTestbed:
    """One of the environments that integ-gym registers.

    Args:
        env_id: its id.
        arguments: of its constructor, without the discretization.
    """

    batched = True
    control_period = None
    horizon = "duration"

    def __init__(self, env_id: str, **arguments: Any) -> None:
        self.env_id = env_id
        self.arguments = arguments

    @property
    def home(self) -> Discretization:
        """The environment's defaults."""
        return Discretization.of(environment_setup(self.env_id, {}))

    @property
    def success(self) -> Success:
        """The task's goal."""
        return Success(environment_class(self.env_id).task_class().goal)

    @property
    def controller(self) -> str:
        """Hand-made controllers are named as their tasks."""
        return environment_class(self.env_id).task_name

    def integrators(self, engine: str) -> tuple[str, ...]:
        """The engine's own names."""
        return tuple(name for name in ENGINES.load(engine).maps if name != TRUTH)

    def steps(self, home: Discretization) -> tuple[float, ...]:
        """The control period, half and a quarter of it, or of a part that divides all delays."""
        coarsest = dividing_step({**self.arguments, "dt": home.control_period})
        return tuple(coarsest / parts for parts in REFINEMENTS)

    def truth(self, control_period: float) -> Discretization:
        """The reference at one step per decision, for its result does not depend on the step."""
        return Discretization(TRUTH, control_period, control_period)

    def make(
        self, discretization: Discretization, lanes: int, **arguments: Any
    ) -> DiscretizedVectorEnv:
        """As ``gymnasium.make_vec``."""
        given = {**self.arguments, **discretization.arguments(), **arguments}
        made = gym.make_vec(self.env_id, lanes, vectorization_mode="vector_entry_point", **given)
        assert isinstance(made, DiscretizedVectorEnv)
        return made

    def applied(self, environments: DiscretizedVectorEnv) -> Applied:
        """From the setup, which is what the environments step."""
        (setup,) = environments.setups
        return Applied(Discretization.of(setup), setup.timing.substeps)
