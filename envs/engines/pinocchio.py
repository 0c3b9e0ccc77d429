"""Pinocchio: its forward dynamics under our integrators."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from typing import Any, ClassVar

import numpy as np

from integ_gym.support.optional import load

from ..mechanics import Link, Mechanism, Slopes
from ..ops.ops import Components, Ops
from ..plants.system import PlantSystem
from ..registries import INTEGRATORS
from .rigid import Array, check_agreement, mechanism_of
from .simulator import integrator_error, refuse_arrays
from .stepping import NativeEngine


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
    maps: ClassVar[Mapping[str, str]] = {name: name for name in ("rk4", *INTEGRATORS.parts)}
    """Integrator to the one-step map that it applies: itself. The environments' default first."""

    def __init__(
        self,
        system: PlantSystem,
        integrator: str,
        dt: float,
        solver: Mapping[str, Any] | None = None,
    ) -> None:
        if integrator not in self.maps and ":" not in integrator:
            raise integrator_error(self.name, integrator, self.maps)
        refuse_arrays(self.name, system)
        self._bodies = bodies = ArticulatedBodies(mechanism_of(self.name, system.plant))
        moved = copy(system.plant)
        vars(moved).update(acceleration=bodies.accelerations, jacobian=bodies.slopes)
        stopped, servo = system.engine_stops is not None, system.servo or system.sampler
        moved_system = PlantSystem(moved, system.max_speed, stopped, servo)
        super().__init__(moved_system, integrator, dt, solver)
        self.map = integrator
        check_agreement(self, system.plant)

    def describe(self) -> dict[str, Any]:
        """What every engine says, and the map that is applied; no stops of its own."""
        return {**super().describe(), "map": self.map, "stops": None}

    def at_rest(self, q: Components) -> tuple[Array, Array]:
        """Mass matrix, and minus the generalized force that holds the model."""
        return self._bodies.at_rest(q)


class ArticulatedBodies:
    """Accelerations of a mechanism by the articulated body algorithm, in float64.

    Source: Featherstone, *Rigid Body Dynamics Algorithms*, chapter 7; derivatives by Carpentier
    and Mansard (2018), *Analytical derivatives of rigid body dynamics algorithms*, RSS XIV.

    Args:
        mechanism: with numbers as parameters.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._pin = pin = load("pinocchio", "pinocchio")
        self._model = pin.Model()
        self._model.gravity.linear = np.array([0.0, 0.0, -mechanism.gravity])
        joint = 0
        for link, offset in zip(mechanism.links, mechanism.offsets, strict=True):
            kind = _joint(pin, link)
            place = pin.SE3(np.eye(3), np.array([0.0, 0.0, offset]))
            joint = self._model.addJoint(joint, kind, place, link.coordinate)
            centre = np.array([0.0, 0.0, link.centre])
            body = pin.Inertia(link.mass, centre, link.inertia * np.eye(3))
            self._model.appendBodyToJoint(joint, body, pin.SE3.Identity())
        self._data = self._model.createData()
        self._damping = np.array([link.damping for link in mechanism.links])
        self._damped = bool(self._damping.any())
        self._stiffness, self._slack = np.array([(x.stiffness, x.slack) for x in mechanism.links]).T
        self._sprung = mechanism.sprung
        self._values = np.zeros(3 * len(mechanism.links))
        self._q, self._v, self._force = np.split(self._values, 3)

    def accelerations(
        self, ops: Ops, q: Components, v: Components, force: Components
    ) -> Components:
        """Accelerations under a generalized force and the joints' damping; of clocks the force."""
        n = len(self._q)
        own = ops.foreign(self._aba, (*q[:n], *v[:n], *force[:n]), (False,) * n)
        return *own, *force[n:]

    def slopes(self, ops: Ops, q: Components, v: Components, force: Components) -> Slopes:
        """(∂a/∂q, ∂a/∂v), each an n×n nested tuple; 0 of clocks."""
        n, still = len(self._q), tuple([0.0 * x for x in q[len(self._q) :]])
        given = (*q[:n], *v[:n], *force[:n])
        flat = ops.foreign(self._derivatives, given, (False,) * (2 * n * n))
        rows = tuple([(*flat[i : i + n], *still) for i in range(0, 2 * n * n, n)])
        clocks = ((0.0 * q[0],) * len(q),) * len(still)
        return (*rows[:n], *clocks), (*rows[n:], *clocks)

    def at_rest(self, q: Components) -> tuple[Array, Array]:
        """Mass matrix by the composite rigid body algorithm, (n, n), and force of gravity, (n,)."""
        place = self._model, self._data, np.array(q)
        held = self._pin.computeGeneralizedGravity(*place)
        return np.array(self._pin.crba(*place)), -np.array(held)

    def _aba(self, *values: float) -> Components:
        self._load(values)
        found = self._pin.aba(self._model, self._data, self._q, self._v, self._force)
        return tuple(found.tolist())

    def _derivatives(self, *values: float) -> Components:
        self._load(values)
        data = self._data
        self._pin.computeABADerivatives(self._model, data, self._q, self._v, self._force)
        by_v = data.ddq_dv - data.Minv * self._damping if self._damped else data.ddq_dv
        by_q = data.ddq_dq - data.Minv * self._stiffness if self._sprung else data.ddq_dq
        return tuple([x for row in (*by_q.tolist(), *by_v.tolist()) for x in row])

    def _load(self, values: tuple[float, ...]) -> None:
        """Put coordinates, velocities and forces, with those of the joints, where they are read."""
        self._values[:] = values
        if self._damped:
            self._force -= self._damping * self._v
        if self._sprung:
            self._force -= self._stiffness * (self._q - self._slack)


def _joint(pin: Any, link: Link) -> Any:
    if link.direction is None:
        return pin.JointModelPX() if link.joint == "slide" else pin.JointModelRY()
    slides, axis = link.joint == "slide", np.array(link.axis, float)
    kind = pin.JointModelPrismaticUnaligned if slides else pin.JointModelRevoluteUnaligned
    return kind(axis)
