"""MuJoCo."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, ClassVar

import numpy as np

from integ_gym.support import load

from ...arithmetic import Components
from .._rigid import LEAST_INERTIA, MAPS, Array, RigidBodyEngine, mjcf
from .._stepping import Run
from .quiet import silencer


class MujocoEngine(RigidBodyEngine):
    """MuJoCo's `mj_step`, in float64.

    `Euler` and `implicitfast` are symplectic Euler with joint damping taken implicitly, `implicit`
    takes all velocity-dependent forces implicitly, `discrete` is `Euler` on mechanisms without
    springs, `RK4` is the classical Runge-Kutta method. Its own stops are constraints, and what
    their solver did is reported: its iterations, under `RK4` those of the last stage.
    """

    name: ClassVar[str] = "mujoco"
    package: ClassVar[str] = "mujoco"
    modules: ClassVar[tuple[str, ...]] = ("mujoco",)
    own_stops: ClassVar[bool] = True
    least_inertia: ClassVar[float] = LEAST_INERTIA
    tells_speeds: ClassVar[bool] = True
    maps: ClassVar[Mapping[str, str]] = MAPS

    def build(self) -> None:
        """Compile the model."""
        self._mujoco = load("mujoco", "mujoco")
        self._model, self._data = self._made()
        self.reports = self.system.engine_stops is not None

    def solver(self) -> dict[str, Any]:
        """Tolerance and iteration cap of the constraint solver, where there are constraints."""
        if not self.reports:
            return super().solver()
        option = self._model.opt
        return {"solver_tolerance": option.tolerance, "solver_cap": option.iterations}

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
        """Take ``count`` steps in one call, or one by one where there is a solver to report on."""
        model, data = self._model, self._data
        put, position, velocity = _setter(data), data.qpos, data.qvel
        solved = self._solved if self.reports else None
        step = self._stepper(model, data, count)

        def run(*values: float) -> tuple[float, ...]:
            put(values)
            report: tuple[float, ...] = ()
            if solved is not None:
                report = solved(count)
            else:
                step()
            end: tuple[float, ...] = (*position.tolist(), *velocity.tolist(), *report)
            return end

        return run

    def run_with_speeds(self, count: int) -> Run:
        """Take ``count`` steps in one call, of which sensors keep the velocities."""
        model, data = self._made(history=count)
        put, position, velocity = _setter(data), data.qpos, data.qvel
        step = self._stepper(model, data, count)
        # Sensors read a step's start: their first value is left out, the very last velocity added.
        ends = [address + 2 + 2 * count for address in model.sensor_historyadr.tolist()]
        told = [data.history[end + 1 - count : end] for end in ends]

        def run(*values: float) -> tuple[float, ...]:
            put(values)
            step()
            last = velocity.tolist()
            pairs = zip(told, last, strict=True)
            squares = [(float(x.dot(x)) + end * end) / count for x, end in pairs]
            return (*position.tolist(), *last, *squares)

        return run

    def _made(self, history: int = 0) -> tuple[Any, Any]:
        """A model and its data."""
        text = mjcf(self.mechanism, self.dt, self.integrator, self.system.engine_stops, history)
        model = self._mujoco.MjModel.from_xml_string(text)
        data = self._mujoco.MjData(model)
        silencer(self._mujoco, data)()
        return model, data

    def _stepper(self, model: Any, data: Any, count: int) -> Callable[[], None]:
        step = partial(self._mujoco.mj_step, model, data)
        return step if count == 1 else partial(step, nstep=count)

    def _solved(self, count: int) -> tuple[int, float, bool]:
        """Take steps with constraints, each from no guess; most iterations, 0 and convergence."""
        model, data, most = self._model, self._data, 0
        for _ in range(count):
            data.qacc_warmstart[:] = 0.0
            self._mujoco.mj_step(model, data)
            most = max(most, int(data.solver_niter.max()))
        return most, 0.0, most < model.opt.iterations

    def _forward(self, q: Components) -> Any:
        """Data at rest in ``q``."""
        data = self._mujoco.MjData(self._model)
        data.qpos[:] = q
        self._mujoco.mj_forward(self._model, data)
        return data


def _setter(data: Any) -> Callable[[tuple[float, ...]], None]:
    """What puts configuration, velocity and force into a model's data."""
    position, velocity, applied = data.qpos, data.qvel, data.qfrc_applied
    n = len(position)
    places = tuple(range(n))

    def put(values: tuple[float, ...]) -> None:
        for i in places:
            position[i] = values[i]
            velocity[i] = values[n + i]
            applied[i] = values[2 * n + i]

    return put
