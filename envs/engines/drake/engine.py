"""Drake: the plant as a `MultibodyPlant`, under its integrators or its contact solvers."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from math import inf
from typing import Any, ClassVar

import numpy as np

from integ_gym.support.packages.extras import load

from ...arithmetic.ops import Components
from ...mechanics.mechanism import Link
from .._rigid.agreement import Array
from .._rigid.bodies import RigidBodyEngine
from .._stepping.foreign import Run
from .implicit import ACCURACY, implicit_steps, rest_serves
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
    tells_speeds: ClassVar[bool] = True
    stopless: ClassVar[frozenset[str]] = frozenset({*EXPLICIT, *IMPLICIT})
    maps: ClassVar[Mapping[str, str]] = {**DISCRETE, **EXPLICIT, **IMPLICIT}

    def build(self) -> None:
        """Make the model, finalized, with generalized forces as its only input.

        An implicit integrator tells its target accuracy; Drake's cap of iterations is not told.
        """
        self.reports = self.integrator not in DISCRETE
        if self.integrator in IMPLICIT:
            self.solver_tolerance = ACCURACY
        plants = load("pydrake.multibody.plant", "drake")
        self._plant = plant = plants.MultibodyPlant(0.0 if self.reports else self.dt)
        if not self.reports:
            approximations = plants.DiscreteContactApproximation.__members__
            chosen = approximations[f"k{self.integrator.capitalize()}"]
            plant.set_discrete_contact_approximation(chosen)
            plant.SetUseSampledOutputPorts(False)
        parent = plant.world_frame()
        for link in self.mechanism.links:
            parent = _added(plant, parent, link)
        plant.mutable_gravity_field().set_gravity_vector((0.0, 0.0, -self.mechanism.gravity))
        plant.Finalize()

    def stop_parameters(self) -> dict[str, Any]:
        """What its law is made of; stiffness and damping follow from the step and the masses."""
        solver = self._plant.get_discrete_contact_solver().name
        known = {"discrete_contact_solver": solver, "time_step": self._plant.time_step()}
        if solver == "kSap":
            known["sap_near_rigid_threshold"] = self._plant.get_sap_near_rigid_threshold()
        return known

    def at_rest(self, q: Components) -> tuple[Array, Array]:
        """Mass matrix and generalized force of gravity."""
        plant, context = self._plant, self._plant.CreateDefaultContext()
        plant.SetPositions(context, q)
        gravity = plant.CalcGravityGeneralizedForces(context)
        return np.array(plant.CalcMassMatrix(context)), np.array(gravity)

    def run_with_speeds(self, count: int) -> Run:
        """Take ``count`` steps and note the velocities of each."""
        return self.run(count, speeds=True)

    def run(self, count: int, speeds: bool = False) -> Run:
        """Take ``count`` steps."""
        if self.integrator in DISCRETE:
            return discrete_steps(self._plant, count, speeds)
        chosen = self._plant, self.integrator, self.dt, count
        if self.integrator in IMPLICIT:
            return implicit_steps(*chosen, self._from_rest, speeds)
        return explicit_steps(*chosen, speeds)

    @cached_property
    def _from_rest(self) -> bool:
        return rest_serves(self._plant, self.integrator, self.dt)


def _added(plant: Any, parent: Any, link: Link) -> Any:
    """Hang a link on a frame; its own frame."""
    tree = load("pydrake.multibody.tree", "drake")
    inertia = tree.RotationalInertia(link.inertia, link.inertia, link.inertia)
    body = plant.AddRigidBody(
        link.coordinate,
        tree.SpatialInertia.MakeFromCentralInertia(link.mass, (0.0, 0.0, link.centre), inertia),
    )
    kind, axis = {
        "slide": (tree.PrismaticJoint, (1.0, 0.0, 0.0)),
        "hinge": (tree.RevoluteJoint, (0.0, 1.0, 0.0)),
    }[link.joint]
    limit = inf if link.limit is None else link.limit
    frame = body.body_frame()
    plant.AddJoint(kind(link.coordinate, parent, frame, axis, -limit, limit, link.damping))
    return frame
