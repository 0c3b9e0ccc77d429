"""Pinocchio."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from typing import Any, ClassVar

from integ_gym.support import package_version

from ...arithmetic import Components
from ...integrators import INTEGRATORS
from ...mechanics import PlantSystem
from ...plants import Plant
from .._rigid import check_agreement, mechanism_of
from .._stepping import lacks_integrator, refuse_arrays
from ..native import NativeEngine
from .aba import Array, ArticulatedBodies


class PinocchioEngine(NativeEngine):
    """Our integrators over Pinocchio's articulated body algorithm `aba`, in float64.

    Pinocchio has no integrators of its own. Damping is subtracted from the force, since `aba`
    leaves `model.damping` out; stops and friction act within the integrator's stages, as in the
    native engine. Implicit integrators take their Jacobian from `computeABADerivatives`.

    Raises:
        ValueError: for an unknown integrator, a plant without a mechanism, plant parameters given
            as arrays, and a model whose mass matrix or gravity force is not the plant's.
    """

    name: ClassVar[str] = "pinocchio"
    package: ClassVar[str] = "pin"
    modules: ClassVar[tuple[str, ...]] = ("pinocchio",)
    batched: ClassVar[bool] = False
    maps: ClassVar[Mapping[str, str]] = {name: name for name in ("rk4", *INTEGRATORS.names())}
    """Integrator to the one-step map that it applies: itself. The environments' default first."""

    def __init__(self, system: PlantSystem, integrator: str, dt: float) -> None:
        if integrator not in self.maps and ":" not in integrator:
            raise lacks_integrator(self.name, integrator, self.maps)
        refuse_arrays(self.name, system)
        self._bodies = ArticulatedBodies(mechanism_of(self.name, system.plant))
        moved = _moved_by(system.plant, self._bodies)
        stopped = system.engine_stops is not None
        super().__init__(PlantSystem(moved, system.max_speed, stopped), integrator, dt)
        self.map = integrator
        self.version = package_version(self.package) or "unknown"
        check_agreement(self, system.plant)

    def describe(self) -> dict[str, Any]:
        """What every engine says, and the map that is applied; no stops of its own."""
        return {**super().describe(), "map": self.map, "stops": None}

    def inertia(self, q: Components) -> Array:
        """Mass matrix by the composite rigid body algorithm."""
        return self._bodies.inertia(q)

    def gravity(self, q: Components) -> Array:
        """Minus the generalized force that holds the model at rest."""
        return self._bodies.gravity(q)


def _moved_by(plant: Plant, bodies: ArticulatedBodies) -> Plant:
    """A copy of the plant with the accelerations and the Jacobian of ``bodies``."""
    moved = copy(plant)
    vars(moved).update(acceleration=bodies.accelerations, jacobian=bodies.slopes)
    return moved
