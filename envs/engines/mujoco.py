"""MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from integ_gym.envs.engines._agreement import PROBES
from integ_gym.envs.engines._foreign import Run
from integ_gym.envs.engines._mjcf import mjcf
from integ_gym.envs.engines._rigid import Array, RigidBodyEngine
from integ_gym.envs.extras import load
from integ_gym.envs.ops import Components

FASTEST_CHANGE = 1e8
"""Acceleration that a force may cause, m/s² or rad/s²; beyond it MuJoCo would write a log file."""


class MujocoEngine(RigidBodyEngine):
    """MuJoCo's `mj_step`, in float64.

    `Euler` and `implicitfast` are symplectic Euler with joint damping taken implicitly, `implicit`
    takes all velocity-dependent forces implicitly, `discrete` is `Euler` on mechanisms without
    springs, `RK4` is the classical Runge-Kutta method.
    """

    name: ClassVar[str] = "mujoco"
    package: ClassVar[str] = "mujoco"
    own_stops: ClassVar[bool] = True
    maps: ClassVar[Mapping[str, str]] = {
        "Euler": "symplectic_euler_implicit_damping",
        "implicitfast": "symplectic_euler_implicit_damping",
        "implicit": "symplectic_euler_implicit_velocity",
        "discrete": "symplectic_euler_implicit_damping",
        "RK4": "rk4",
    }

    def build(self) -> None:
        """Compile the model."""
        mujoco = load("mujoco", "mujoco")
        text = mjcf(self.mechanism, self.dt, self.integrator, self.system.engine_stops)
        self._model = mujoco.MjModel.from_xml_string(text)
        self._data = mujoco.MjData(self._model)
        self._mujoco = mujoco

    def stop_parameters(self) -> dict[str, Any]:
        """`solref` and `solimp` of the limited joint."""
        assert self.system.engine_stops is not None
        joint = self.system.engine_stops.coordinate
        solref, solimp = self._model.jnt_solref[joint], self._model.jnt_solimp[joint]
        return {"solref": solref.tolist(), "solimp": solimp.tolist()}

    def inertia(self, q: Components) -> Array:
        """Mass matrix by the composite rigid body algorithm."""
        data, size = self._forward(q), self._model.nv
        full = np.zeros((size, size))
        self._mujoco.mj_fullM(self._model, data, full)
        return full

    def gravity(self, q: Components) -> Array:
        """Minus the bias force at rest."""
        return -np.array(self._forward(q).qfrc_bias)

    def run(self, count: int) -> Run:
        """Take ``count`` steps in one call."""
        n = self._model.nv
        places = tuple(range(n))
        position, velocity, applied = self._data.qpos, self._data.qvel, self._data.qfrc_applied
        model, data, step = self._model, self._data, self._mujoco.mj_step
        strongest = FASTEST_CHANGE * self._lightest()
        lost: tuple[float, ...] = (math.nan,) * (2 * int(n))

        def run(*values: float) -> tuple[float, ...]:
            for i in places:
                if not -strongest < values[2 * n + i] < strongest:
                    return lost
                position[i] = values[i]
                velocity[i] = values[n + i]
                applied[i] = values[2 * n + i]
            if count == 1:
                step(model, data)
            else:
                step(model, data, nstep=count)
            end: tuple[float, ...] = (*position.tolist(), *velocity.tolist())
            return end

        return run

    def _lightest(self) -> float:
        """Smallest eigenvalue of the mass matrix."""
        matrices = [self.inertia(probe[-self._model.nv :]) for probe in PROBES]
        return float(np.linalg.eigvalsh(matrices).min())

    def _forward(self, q: Components) -> Any:
        """Data at rest in ``q``."""
        data = self._mujoco.MjData(self._model)
        data.qpos[:] = q
        self._mujoco.mj_forward(self._model, data)
        return data
