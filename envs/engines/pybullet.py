"""PyBullet."""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from integ_gym.support.errors import SetupError

from ..ops.ops import Components
from .rigid import Array, RigidBodyEngine, urdf
from .simulator import Run, load_undisturbed

UNCAPPED = 1e30
"""Joint speed at which Bullet clips, m/s or rad/s; 100 where it is not set."""

SOLVER = {"erp": 0.2, "numSolverIterations": 50, "solverResidualThreshold": 1e-7}
"""Bullet's own values of what its joint limits depend on."""


class PybulletEngine(RigidBodyEngine):
    """Bullet's multibody `stepSimulation`, in float64: symplectic Euler with explicit damping.

    Bullet's own motors, link damping and speed limit are switched off, and inertia is what we
    give. Each engine has a physics client of its own, about 30 MB, closed with it. With its own
    stops it reports its constraint solver's iterations, and the squared residual that they left.

    Raises:
        RuntimeError: if PyBullet has no client left of its 1024, in addition to what engines of
            rigid bodies refuse.
    """

    name: ClassVar[str] = "pybullet"
    package: ClassVar[str] = "pybullet"
    modules: ClassVar[tuple[str, ...]] = ("pybullet",)
    maps: ClassVar[Mapping[str, str]] = {"semi_implicit_euler": "symplectic_euler"}
    zero_settings: ClassVar[tuple[str, ...]] = ("erp", "solverResidualThreshold")
    solver_defaults: ClassVar[Mapping[str, Mapping[str, Any]]] = {"semi_implicit_euler": SOLVER}

    def build(self) -> None:
        """Load the model into a world of its own."""
        bullet = load_undisturbed("pybullet", "pybullet")
        self._bullet = bullet
        self._client = client = _connect(bullet)
        weakref.finalize(self, bullet.disconnect, client)
        bullet.setGravity(0.0, 0.0, -self.mechanism.gravity, physicsClientId=client)
        bullet.setTimeStep(self.dt, physicsClientId=client)
        self.reports = self.system.engine_stops is not None
        if self.reports:
            self.solver_tolerance = self.settings["solverResidualThreshold"]
            self.solver_cap = self.settings["numSolverIterations"]
        bullet.setPhysicsEngineParameter(
            **self.settings, reportSolverAnalytics=int(self.reports), physicsClientId=client
        )
        self._body = self._load()
        for joint in range(len(self.mechanism.links)):
            bullet.setJointMotorControl2(
                self._body, joint, bullet.VELOCITY_CONTROL, force=0.0, physicsClientId=client
            )
        for link in range(-1, len(self.mechanism.links)):
            bullet.changeDynamics(
                self._body, link, linearDamping=0.0, angularDamping=0.0,
                maxJointVelocity=UNCAPPED, physicsClientId=client,
            )  # fmt: skip

    def stop_parameters(self) -> dict[str, Any]:
        """Of the constraint solver, in the names of `setPhysicsEngineParameter`."""
        return dict(self.settings)

    def at_rest(self, q: Components) -> tuple[Array, Array]:
        """Mass matrix by the composite rigid body algorithm, and minus the force that holds it."""
        bullet, still = self._bullet, (0.0,) * len(q)
        mass = bullet.calculateMassMatrix(self._body, q, physicsClientId=self._client)
        holding = bullet.calculateInverseDynamics(
            self._body, q, still, still, physicsClientId=self._client
        )
        return np.array(mass), -np.array(holding)

    def run(self, count: int) -> Run:
        """Set the state, then push and step ``count`` times: a push lasts for one step."""
        bullet, body, client = self._bullet, self._body, self._client
        reset, push, torque = (
            bullet.resetJointState, bullet.setJointMotorControl2, bullet.TORQUE_CONTROL,
        )  # fmt: skip
        step, states = bullet.stepSimulation, bullet.getJointStates
        n = len(self.mechanism.links)
        joints = tuple(range(n))
        reports, cap = self.reports, self.settings["numSolverIterations"]

        def run(*values: float) -> tuple[float, ...]:
            for i in joints:
                reset(body, i, values[i], values[n + i], client)
            most, worst = 0, 0.0
            for _ in range(count):
                for i in joints:
                    if values[2 * n + i] != 0.0:
                        push(body, i, torque, force=values[2 * n + i], physicsClientId=client)
                for solved in step(client):
                    most = max(most, solved["numIterationsUsed"])
                    worst = max(worst, solved["remainingResidual"])
            ends = states(body, joints, client)
            report = (most, worst, most < cap) if reports else ()
            return (*[state[0] for state in ends], *[state[1] for state in ends], *report)

        return run

    def text(self) -> str:
        """The model."""
        return urdf(self.mechanism)

    def _load(self) -> int:
        """The model's number in its world."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "mechanism.urdf")
            path.write_text(self.text(), encoding="utf-8")
            body: int = self._bullet.loadURDF(
                str(path),
                useFixedBase=True,
                flags=self._bullet.URDF_USE_INERTIA_FROM_FILE,
                physicsClientId=self._client,
            )
        return body


def _connect(bullet: Any) -> int:
    """A client that is not number 0, which PyBullet's functions mean where none is named."""
    try:
        client: int = bullet.connect(bullet.DIRECT)
        if client == 0:
            client = bullet.connect(bullet.DIRECT)
            bullet.disconnect(0)
    except bullet.error as error:
        raise SetupError(
            f"PyBullet gives no physics client: {error} Delete environments that you do not use, "
            "or take one vector environment, whose lanes share a client"
        ) from error
    return client
