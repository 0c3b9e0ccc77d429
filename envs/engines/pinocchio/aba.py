"""Pinocchio's model of a mechanism, called with floats."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from integ_gym.support import load

from ...arithmetic import Components, Ops
from ...mechanics import Mechanism

Array = npt.NDArray[np.float64]
Rows = tuple[Components, ...]

_JOINTS = {"slide": "JointModelPX", "hinge": "JointModelRY"}


class ArticulatedBodies:
    """Accelerations of a mechanism by the articulated body algorithm, in float64.

    Source: Featherstone, *Rigid Body Dynamics Algorithms*, chapter 7; derivatives by Carpentier
    and Mansard (2018), *Analytical derivatives of rigid body dynamics algorithms*, RSS XIV.

    Args:
        mechanism: with numbers as parameters.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        pin = load("pinocchio", "pinocchio")
        self._pin = pin
        self._model = pin.Model()
        self._model.gravity.linear = np.array([0.0, 0.0, -mechanism.gravity])
        joint = 0
        for link in mechanism.links:
            kind = getattr(pin, _JOINTS[link.joint])()
            joint = self._model.addJoint(joint, kind, pin.SE3.Identity(), link.coordinate)
            centre = np.array([0.0, 0.0, link.centre])
            body = pin.Inertia(link.mass, centre, link.inertia * np.eye(3))
            self._model.appendBodyToJoint(joint, body, pin.SE3.Identity())
        self._data = self._model.createData()
        self._damping = np.array([link.damping for link in mechanism.links])
        self._damped = bool(self._damping.any())
        self._values = np.zeros(3 * len(mechanism.links))
        self._q, self._v, self._force = np.split(self._values, 3)

    def accelerations(
        self, ops: Ops, q: Components, v: Components, force: Components
    ) -> Components:
        """Accelerations under a generalized force and the joints' damping."""
        return ops.foreign(self._aba, (*q, *v, *force), (False,) * len(q))

    def slopes(
        self, ops: Ops, q: Components, v: Components, force: Components
    ) -> tuple[Rows, Rows]:
        """(∂a/∂q, ∂a/∂v), each an n×n nested tuple."""
        n = len(q)
        flat = ops.foreign(self._derivatives, (*q, *v, *force), (False,) * (2 * n * n))
        rows = tuple([flat[i : i + n] for i in range(0, 2 * n * n, n)])
        return rows[:n], rows[n:]

    def inertia(self, q: Components) -> Array:
        """Mass matrix by the composite rigid body algorithm, (n, n)."""
        return np.array(self._pin.crba(self._model, self._data, np.array(q)))

    def gravity(self, q: Components) -> Array:
        """Generalized force of gravity, (n,)."""
        held = self._pin.computeGeneralizedGravity(self._model, self._data, np.array(q))
        return -np.array(held)

    def _aba(self, *values: float) -> Components:
        self._load(values)
        found = self._pin.aba(self._model, self._data, self._q, self._v, self._force)
        return tuple(found.tolist())

    def _derivatives(self, *values: float) -> Components:
        self._load(values)
        data = self._data
        self._pin.computeABADerivatives(self._model, data, self._q, self._v, self._force)
        by_v = data.ddq_dv - data.Minv * self._damping if self._damped else data.ddq_dv
        return tuple([x for row in (*data.ddq_dq.tolist(), *by_v.tolist()) for x in row])

    def _load(self, values: tuple[float, ...]) -> None:
        """Put coordinates, velocities and forces, less damping, where Pinocchio reads them."""
        self._values[:] = values
        if self._damped:
            self._force -= self._damping * self._v
