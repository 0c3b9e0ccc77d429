"""MuJoCo, called through its Python bindings."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, ClassVar

import numpy as np

from integ_gym.support.optional import load

from ..ops.ops import Components
from .mujoco_solver import NO_RESET, MujocoSettings, write_solver
from .rigid import LEAST_INERTIA, MAPS, Array, RigidBodyEngine, mass_matrix, mjcf, stop_law
from .simulator import Run

_TOLD_OF = ("INERTIA", "BADQPOS", "BADQVEL", "BADQACC")


class MujocoEngine(MujocoSettings, RigidBodyEngine):
    """MuJoCo's `mj_step`, in float64.

    `Euler` and `implicitfast` are symplectic Euler with joint damping taken implicitly, `implicit`
    takes all velocity-dependent forces implicitly, `discrete` is `Euler` on mechanisms without
    springs, `RK4` is the classical Runge-Kutta method. Its own stops are constraints, and what
    their solver did is reported: its iterations, under `RK4` those of the last stage.
    """

    name: ClassVar[str] = "mujoco"
    package: ClassVar[str] = "mujoco"
    modules: ClassVar[tuple[str, ...]] = ("mujoco",)
    least_inertia: ClassVar[float] = LEAST_INERTIA
    own_springs: ClassVar[bool] = True
    tells_speeds: ClassVar[bool] = True
    maps: ClassVar[Mapping[str, str]] = MAPS

    def build(self) -> None:
        """Compile the model."""
        self._mujoco = load("mujoco", "mujoco")
        self._model, self._data = self._compile()
        self.settings = self.settings_of(self._mujoco, self._model)
        self.reports = self.system.engine_stops is not None
        if self.reports:
            option = self._model.opt
            self.solver_tolerance, self.solver_cap = option.tolerance, option.iterations

    def stop_parameters(self) -> dict[str, Any]:
        """`solref` and `solimp` of the limited joint."""
        return stop_law(self._model, self.system.engine_stops)

    def at_rest(self, q: Components) -> tuple[Array, Array]:
        """Mass matrix by the composite rigid body algorithm, and minus the bias force."""
        data = self._mujoco.MjData(self._model)
        data.qpos[:] = q
        self._mujoco.mj_forward(self._model, data)
        return mass_matrix(self._mujoco, self._model, data), -data.qfrc_bias

    def forward_dynamics(self, q: Components, v: Components, force: Components) -> Array:
        """By `mj_forward` under `Euler`: under `discrete` it looks ahead by a step."""
        text = mjcf(self.mechanism, self.dt, "Euler")
        model = self._mujoco.MjModel.from_xml_string(text)
        data = self._mujoco.MjData(model)
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, v, force
        self._mujoco.mj_forward(model, data)
        return np.array(data.qacc)

    def run(self, count: int) -> Run:
        """Take ``count`` steps in one call, or one by one where there is a solver to report on."""
        model, data = self._model, self._data
        put, position, velocity = _setter(data), data.qpos, data.qvel
        step = partial(self._solve, count) if self.reports else self._stepper(model, data, count)

        def run(*values: float) -> tuple[float, ...]:
            put(values)
            report = step() or ()
            return (*position.tolist(), *velocity.tolist(), *report)

        return run if hasattr(self._mujoco.mjtDisableBit, NO_RESET) else self._lost(run)

    def _lost(self, run: Run) -> Run:
        """The same where MuJoCo, before 3.2, resets a motion that diverges: that is not finite."""
        data, size, begun = self._data, 2 * len(self._data.qpos), 1.0

        def run_or_lose(*values: float) -> tuple[float, ...]:
            data.time = begun
            found = run(*values)
            return found if data.time >= begun else (math.nan,) * size + found[size:]

        return run_or_lose

    def run_with_speeds(self, count: int) -> Run:
        """Take ``count`` steps in one call, of which sensors keep the velocities."""
        model, data = self._compile(history=count)
        put, position, velocity = _setter(data), data.qpos, data.qvel
        step = self._stepper(model, data, count)
        # Sensors read a step's start: their first value is left out, the very last velocity added.
        ends = [address + 2 + 2 * count for address in model.sensor_historyadr.tolist()]
        histories = [data.history[end + 1 - count : end] for end in ends]

        def run(*values: float) -> tuple[float, ...]:
            put(values)
            step()
            last = velocity.tolist()
            pairs = zip(histories, last, strict=True)
            squares = [(float(x.dot(x)) + end * end) / count for x, end in pairs]
            return (*position.tolist(), *last, *squares)

        return run

    def _compile(self, history: int = 0) -> tuple[Any, Any]:
        """A model and its data."""
        text = mjcf(self.mechanism, self.dt, self.integrator, history)
        model = self._mujoco.MjModel.from_xml_string(text)
        write_solver(self._mujoco, model, self.settings)
        model.opt.disableflags |= int(getattr(self._mujoco.mjtDisableBit, NO_RESET, 0))
        data = self._mujoco.MjData(model)
        silencer(self._mujoco, data)()
        return model, data

    def _stepper(self, model: Any, data: Any, count: int) -> Callable[[], Any]:
        step = partial(self._mujoco.mj_step, model, data)
        return step if count == 1 else partial(step, nstep=count)

    def _solve(self, count: int) -> tuple[int, float, bool]:
        """Take steps with constraints, each from no guess; most iterations, 0 and convergence."""
        model, data, most = self._model, self._data, 0
        for _ in range(count):
            data.qacc_warmstart[:] = 0.0
            self._mujoco.mj_step(model, data)
            most = max(most, int(data.solver_niter.max()))
        return most, 0.0, most < model.opt.iterations


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


def silencer(mujoco: Any, data: Any) -> Callable[[], None]:
    """A function that makes ``data`` one whose divergence is not written about.

    MuJoCo writes to standard error and to the file MUJOCO_LOG.TXT when it counts the first warning
    of a kind in ``data``; this counts one of each kind that a divergence is known by. It lasts
    until ``mj_resetData``. Other data of the process, and other warnings, are as they were.
    """
    numbers = data.warning.number
    kinds = [int(getattr(mujoco.mjtWarning, f"mjWARN_{kind}")) for kind in _TOLD_OF]

    def silence() -> None:
        for kind in kinds:
            numbers[kind] = numbers[kind] or 1

    return silence
