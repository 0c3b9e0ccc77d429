"""Drake."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ...arithmetic import Components
from .._rigid import Array, RigidBodyEngine
from .._stepping import Run
from .implicit import ACCURACY, implicit_steps, rest_serves
from .model import multibody_plant
from .steps import discrete_steps, explicit_steps

EXPLICIT = {
    "explicit_euler": "explicit_euler",
    "semi_explicit_euler": "symplectic_euler",
    "runge_kutta2": "heun",
    "runge_kutta3": "kutta3",
    "bogacki_shampine3": "bogacki_shampine3",
    "runge_kutta5": "dormand_prince5",
}
IMPLICIT = {
    "radau1": "implicit_euler",
    "radau3": "radau_iia3",
    "implicit_euler": "implicit_euler_half_steps",
    "velocity_implicit_euler": "implicit_euler_half_steps",
}
DISCRETE = {
    "tamsi": "symplectic_euler",
    "sap": "symplectic_euler_implicit_damping",
    "similar": "symplectic_euler_implicit_damping",
    "lagged": "symplectic_euler_implicit_damping",
}


class DrakeEngine(RigidBodyEngine):
    """Drake's `MultibodyPlant`, in float64: continuous under an integrator, or discrete.

    A continuous plant takes fixed steps; its `implicit_euler` and `velocity_implicit_euler` return
    the two half steps of their error estimate. A discrete one is stepped by its contact solver:
    `tamsi` takes joint damping explicitly, `sap`, `similar` and `lagged` implicitly. Only discrete
    plants heed joint limits, and they alone do not report what they solve.
    """

    name: ClassVar[str] = "drake"
    package: ClassVar[str] = "drake"
    modules: ClassVar[tuple[str, ...]] = ("pydrake",)
    own_stops: ClassVar[bool] = True
    tells_speeds: ClassVar[bool] = True
    stopless: ClassVar[frozenset[str]] = frozenset({*EXPLICIT, *IMPLICIT})
    maps: ClassVar[Mapping[str, str]] = {**DISCRETE, **EXPLICIT, **IMPLICIT}

    def build(self) -> None:
        """Make the model."""
        self.reports = self.integrator not in DISCRETE
        if self.reports:
            self._plant = multibody_plant(self.mechanism)
        else:
            stops = self.system.engine_stops
            self._plant = multibody_plant(self.mechanism, self.dt, self.integrator, stops)

    def solver(self) -> dict[str, Any]:
        """Target accuracy of an implicit integrator; Drake's cap of iterations is not told."""
        implicit = self.integrator in IMPLICIT
        return {**super().solver(), "solver_tolerance": ACCURACY if implicit else None}

    def stop_parameters(self) -> dict[str, Any]:
        """What its law is made of; stiffness and damping follow from the step and the masses."""
        solver = self._plant.get_discrete_contact_solver().name
        known = {"discrete_contact_solver": solver, "time_step": self._plant.time_step()}
        if solver == "kSap":
            known["sap_near_rigid_threshold"] = self._plant.get_sap_near_rigid_threshold()
        return known

    def inertia(self, q: Components) -> Array:
        """Mass matrix."""
        return np.array(self._plant.CalcMassMatrix(self._at_rest(q)))

    def gravity(self, q: Components) -> Array:
        """Generalized force of gravity."""
        return np.array(self._plant.CalcGravityGeneralizedForces(self._at_rest(q)))

    def run(self, count: int) -> Run:
        """Take ``count`` steps."""
        return self._steps(count)

    def run_with_speeds(self, count: int) -> Run:
        """Take ``count`` steps and note the velocities of each."""
        return self._steps(count, speeds=True)

    def _steps(self, count: int, speeds: bool = False) -> Run:
        if self.integrator in DISCRETE:
            return discrete_steps(self._plant, count, speeds)
        chosen = self._plant, self.integrator, self.dt, count
        if self.integrator in IMPLICIT:
            return implicit_steps(*chosen, self._from_rest, speeds)
        return explicit_steps(*chosen, speeds)

    @cached_property
    def _from_rest(self) -> bool:
        return rest_serves(self._plant, self.integrator, self.dt)

    def _at_rest(self, q: Components) -> Any:
        """A context with the model at rest in ``q``."""
        context = self._plant.CreateDefaultContext()
        self._plant.SetPositions(context, q)
        return context
