"""MJX's step as a function of numbers: mechanism, state and force."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Final

import numpy as np

from integ_gym.support.errors import InputError
from integ_gym.support.optional import load

from ..ops.ops import Component, Components, Ops
from ..plants.system import PlantSystem
from .mujoco_solver import SETTINGS, MujocoSettings
from .rigid import MAPS, Array, LanesEngine, joint_masses, stop_law
from .simulator import Run, silence_output

SETTABLE = tuple(name for name in SETTINGS if not name.startswith(("noslip", "cone")))
"""Settings of MuJoCo's solver that MJX takes for plants without contacts."""

FLOAT_WIDTH: Final = "float_width"
"""Setting beside those of MuJoCo's solver: bits of the floats, 32 or 64."""

FINEST_SINGLE: Final = 1e-8
"""Between the rounding of float64 and of float32."""


class MjxEngine(MujocoSettings, LanesEngine):
    """`mjx.step`, traced in JAX; for floats and NumPy compiled, on the CPU.

    There it computes in float64, or with the setting `float_width` of 32 in float32. Traced by
    others it computes with their floats.

    `Euler` and `implicitfast` are symplectic Euler with joint damping taken implicitly, `RK4` is
    the classical Runge-Kutta method. MJX has none of MuJoCo's `implicit` and `discrete`.
    """

    name: ClassVar[str] = "mjx"
    package: ClassVar[str] = "mujoco-mjx"
    modules: ClassVar[tuple[str, ...]] = ("mujoco.mjx", "jax")
    batched: ClassVar[bool] = True
    maps: ClassVar[Mapping[str, str]] = {own: MAPS[own] for own in ("Euler", "implicitfast", "RK4")}

    @classmethod
    def settable(cls, integrator: str) -> tuple[str, ...]:
        """Those of MuJoCo's that MJX takes for plants without contacts, and the floats' width."""
        return (*SETTABLE, FLOAT_WIDTH)

    def read_solver(self, given: Mapping[str, Any]) -> None:
        """Keep what was given, for the model, and the width of floats.

        Raises:
            ValueError: for a setting that MJX has not, or an impossible value.
        """
        others = dict(given)
        self.width = others.pop(FLOAT_WIDTH, 64)
        if self.width not in (32, 64):
            raise InputError(f"`solver.{FLOAT_WIDTH}` must be 32 or 64, got {self.width!r}")
        super().read_solver(others)

    def build(self) -> None:
        """Make the program and place the model's numbers."""
        jax = load("jax", "mjx")
        with silence_output():
            load("mujoco.mjx", "mjx")
            mujoco = load("mujoco", "mjx")
            from .mjx_program import numbers, program_of

        self._jax, self._numbers = jax, numbers
        self._program = program_of(self.mechanism, self.integrator, self.settings, self.width)
        read = self.settings_of(mujoco, self._program.made)
        self.settings = {**read, FLOAT_WIDTH: self.width}
        stop = self._stop()
        with self._floats():
            self._values, self._still = (
                jax.device_put(np.array(numbers(self.mechanism, dt, stop)), jax.devices("cpu")[0])
                for dt in (self.dt, 0.0)
            )

    def at(self, system: PlantSystem, dt: Component) -> MjxEngine:
        """The same engine for other values of the parameters, traced or arrays of JAX's."""
        other = super().at(system, dt)
        other.mechanism = system.plant.mechanism.solid  # type: ignore[attr-defined]
        if self.held_springs is not None:
            other.held_springs = other.mechanism
        other._damped = True
        return other

    def stop_parameters(self) -> dict[str, Any]:
        """`solref` and `solimp` of the limited joint."""
        return stop_law(self._program.made, self.system.engine_stops)

    def at_rest(self, q: Components) -> tuple[Array, Array]:
        """Mass matrix and minus the bias force, of a step that takes no time."""
        start = np.array([[*q, *(0.0,) * (2 * len(q))]])
        _, mass, bias = self._run_lanes(self._still, start, 1)
        return np.asarray(mass), -np.asarray(bias)

    def run(self, count: int) -> Run:
        """Take ``count`` steps in one call."""
        step, values, floats = self._program.run, self._values, self._floats
        starts = np.zeros((self._program.lanes, 3 * self._program.dof))

        def run(*start: float) -> tuple[float, ...]:
            starts[0] = start
            with floats():
                return tuple(np.asarray(step(values, starts, count, 1)[0])[0].tolist())

        return run

    def run_lanes(self, starts: Array, count: int) -> Array:
        """Take ``count`` steps, some dozens of lanes in one call."""
        size = self._program.lanes
        parts = [starts[k : k + size] for k in range(0, len(starts), size)]
        return np.concatenate([self._run_lanes(self._values, part, count)[0] for part in parts])

    def travel(
        self, ops: Ops, q: Components, v: Components, force: Components, count: int
    ) -> tuple[Components, Components, Component, Component, Component]:
        """Take ``count`` steps; q, v, and the solver's iterations, residual and convergence."""
        if not isinstance(q[0], self._jax.Array):
            return super().travel(ops, q, v, force, count)
        values = self._numbers(self.mechanism, self.dt, ())
        if self.width == 32 and ops.epsilon < FINEST_SINGLE:
            raise InputError(
                f"`solver.{FLOAT_WIDTH}`=32 is not possible in a traced environment of 64 bits; "
                "give it `dtype`='float32'"
            )

        def step(_: Component, state: tuple[Component, ...]) -> tuple[Component, ...]:
            return self._program.step(values, (*state, *force))

        ends = ops.repeat(count, step, (*q, *v))
        return ends[: len(q)], ends[len(q) :], 0, 0.0, True

    def _stop(self) -> tuple[float, ...]:
        """Limit of the limited joint and inverse of its inertia at 0, by which MuJoCo weighs it."""
        stops, plant = self.system.engine_stops, self.system.plant
        if stops is None:
            return ()
        at_zero = joint_masses(plant, (0.0,) * len(self.system.moving))
        weight = np.linalg.inv(at_zero)[stops.coordinate, stops.coordinate]
        return stops.limit, float(weight)

    def _run_lanes(self, values: Any, starts: Array, count: int) -> tuple[Array, Any, Any]:
        """Ends of some lanes, and of the last the mass matrix and the bias force."""
        filled, used = np.zeros((self._program.lanes, starts.shape[1])), len(starts)
        filled[:used] = starts
        with self._floats():
            ends, mass, bias = self._program.run(values, filled, count, used)
            return np.asarray(ends, np.float64)[:used], mass, bias

    def _floats(self) -> Any:
        """Context in which JAX's floats are of this engine's width."""
        return self._jax.enable_x64(self.width == 64)
