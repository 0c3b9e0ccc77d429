"""What a panel varies: mixtures of discretizations to train on, and cells to evaluate in."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeAlias

from integ_gym.envs.lanes import DiscretizedVectorEnv
from integ_gym.envs.settings import DISCRETIZATION, WEIGHT, Discretization, dividing_step
from integ_gym.envs.testbeds.gym_testbed import Testbed
from integ_gym.envs.testbeds.making import make_checked


@dataclass(frozen=True)
class DiscretizationMixture:
    """Discretizations of one control period, one of which every training episode draws.

    Attributes:
        name: of the mixture.
        weights: by member; its share is its weight over the sum of all.
    """

    name: str
    weights: tuple[tuple[Discretization, float], ...]

    @property
    def shares(self) -> dict[Discretization, float]:
        """Share of each discretization that training draws from."""
        total = sum(weight for _, weight in self.weights)
        return {member: weight / total for member, weight in self.weights}

    @property
    def control_period(self) -> float:
        """Time between two decisions, s."""
        return self.weights[0][0].control_period

    def arguments(self) -> list[dict[str, Any]]:
        """The members, each as constructor arguments of an environment."""
        return [member.arguments() for member, _ in self.weights]


UNNAMED = "its mixture"
"""What the mixture of a policy that was given is called."""

Home: TypeAlias = Discretization | DiscretizationMixture
"""What a policy is trained on."""


def main_home(home: Home | None) -> Discretization | None:
    """The discretization that most of the training ran on, the first of equals; None: unknown."""
    shares = {} if home is None else home.shares
    return max(shares, key=lambda member: shares[member], default=None)


@dataclass(frozen=True)
class Perturbation:
    """Environment arguments that differ from the panel's, on the home and reference cells."""

    name: str
    environment: Mapping[str, Any]


@dataclass(frozen=True)
class Cell:
    """One evaluation column: a discretization, perturbed or not."""

    discretization: Discretization
    kind: str
    """`grid`, `reference`, `perturbation` or `ladder` (the control period follows dt)."""
    perturbation: Perturbation | None = None
    role: str | None = None
    """`reference` or `quarter_step` where the cell decides a comparison of policies."""

    @property
    def name(self) -> str:
        """Unique within a panel."""
        base = self.discretization.name
        if self.kind == "ladder":
            base = f"{base} control={self.discretization.control_period:g}"
        return f"{base}, {self.perturbation.name}" if self.perturbation else base

    def arguments(self, environment: Mapping[str, Any]) -> dict[str, Any]:
        """Constructor arguments of this cell's environment."""
        values = {**environment, **self.discretization.arguments(), **changes_of(self)}
        if self.discretization.integrator == "reference":
            values["dt"] = dividing_step(values)
        return values


def changes_of(cell: Cell) -> Mapping[str, Any]:
    """Arguments that a cell's perturbation changes."""
    return cell.perturbation.environment if cell.perturbation else {}


def environments_of(
    testbed: Testbed, cell: Cell, lanes: int, **changed: Any
) -> DiscretizedVectorEnv:
    """A cell's environments.

    Args:
        testbed: what makes them.
        cell: where.
        lanes: number of environments.
        changed: arguments that differ from the cell's.

    Raises:
        TypeError, ValueError: for a cell that cannot be made.
    """
    given = {**cell.arguments(testbed.arguments), **changed}
    asked = Discretization(**{name: given.pop(name) for name in DISCRETIZATION})
    return make_checked(testbed, asked, lanes, **given)


@lru_cache(maxsize=16)
def nominal_setup(testbed: Testbed, control_period: float) -> Any:
    """The setup of the undisturbed task on its truth, or at home where there is none.

    Baselines are designed from its parameters.
    """
    cell = Cell(testbed.truth(control_period) or testbed.home, "grid")
    environments = environments_of(testbed, cell, 1)
    environments.close()
    return environments.setups[0]


def training_arguments(home: Home, environment: Mapping[str, Any]) -> dict[str, Any]:
    """Constructor arguments of a training environment.

    Args:
        home: what is trained on.
        environment: arguments common to all discretizations.
    """
    if isinstance(home, Discretization):
        return Cell(home, "grid").arguments(environment)
    own = ("engine", "integrator", "dt")
    cells = [(Cell(d, "grid").arguments(environment), weight) for d, weight in home.weights]
    mixture = [{**{name: a[name] for name in own}, WEIGHT: weight} for a, weight in cells]
    common = {name: value for name, value in cells[0][0].items() if name not in own}
    return {**common, "mixture": mixture}


def file_name(row: str) -> str:
    """A row's name as that of its files."""
    return re.sub(r"[^A-Za-z0-9._]+", "-", row)
