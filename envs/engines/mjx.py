"""MJX's step as a function of numbers: mechanism, state and force."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import mjx
from mujoco.mjx._src import forward

from integ_gym.support.packages.extras import load

from ..mechanics import Link, Mechanism, PlantSystem
from ..ops.ops import (
    SCALAR,
    Component,
    Components,
    Ops,
)
from .rigid import LEAST_SHARE, MAPS, LanesEngine, mjcf, stop_law
from .stepping import Run, quiet

Array = Any

LANES = 64
"""Lanes of one call: one compiled program serves any number up to this, one after the other."""


def numbers(mechanism: Mechanism, dt: Component, stop: Sequence[Component]) -> list[Component]:
    """What a program's model is made of.

    Args:
        mechanism: four numbers for each link are taken from it.
        dt: step, s.
        stop: of a limited joint, the limit and the inverse of its inertia at 0; else empty.
    """
    links = [(x.mass, x.centre, x.inertia, x.damping) for x in mechanism.links]
    return [dt, mechanism.gravity, *(number for link in links for number in link), *stop]


def program_of(mechanism: Mechanism, integrator: str) -> Program:
    """The program that serves all mechanisms of these joints.

    Args:
        mechanism: how many joints there are, of what kind, and which has MuJoCo's own stops.
        integrator: MuJoCo's name.
    """
    ones = (1.0,) * 4
    links = tuple(
        Link(x.coordinate, x.joint, *ones, None if x.limit is None else 1.0)
        for x in mechanism.links
    )
    return _program(mjcf(Mechanism(links, 1.0), 1.0, integrator))


class Program:
    """MJX's functions for a chain of joints; masses, lengths, damping and step are arguments.

    Args:
        text: a model in MuJoCo's format; see :func:`numbers` for what is replaced in it.

    Attributes:
        made: MuJoCo's model of it.
        dof: number of joints.
        lanes: of one call.
    """

    def __init__(self, text: str) -> None:
        self.made = made = mujoco.MjModel.from_xml_string(text)
        with jax.enable_x64(True):
            model, data = mjx.put_model(made, impl="jax"), mjx.make_data(made, impl="jax")
        self.dof, self.lanes = made.nv, LANES
        self._stopped = next(iter(made.jnt_limited.nonzero()[0].tolist()), None)
        self._model, self._data = jax.tree.map(np.asarray, (model, data))

    @cached_property
    def run(self) -> Any:
        """Compiled: (numbers, (lanes, 3 dof) of q, v and force, count, used) to (lanes, 2 dof).

        ``count`` steps of the first ``used`` lanes; with the mass matrix and the bias force at the
        start of the very last step.
        """

        def run(values: Array, starts: Array, count: Array, used: Array) -> tuple[Array, ...]:
            def lane(place: Array, carry: tuple[Array, ...]) -> tuple[Array, ...]:
                end, mass, bias = self._steps(values, starts[place], count)
                return carry[0].at[place].set(end), mass, bias

            n = self.dof
            nothing = jnp.zeros((self.lanes, 2 * n)), jnp.zeros((n, n)), jnp.zeros(n)
            end: tuple[Array, ...] = jax.lax.fori_loop(0, used, lane, nothing)
            return end

        return jax.jit(run)

    def step(self, values: Sequence[Component], start: Sequence[Component]) -> tuple[Array, ...]:
        """One step of traced components, which are broadcast against each other."""
        kind = jnp.result_type(*start[: self.dof])
        columns = [jnp.asarray(x, float) for x in (*values, *start)]
        packed = jnp.stack(jnp.broadcast_arrays(*columns), axis=-1)
        ends = self._step(packed[..., : len(values)], packed[..., len(values) :])
        return tuple(jnp.moveaxis(ends.astype(kind), -1, 0))

    @cached_property
    def _step(self) -> Any:
        def end(values: Array, start: Array) -> Array:
            return self._steps(values, start, 1)[0]

        return jax.jit(jnp.vectorize(end, signature="(p),(s)->(e)"))

    def _steps(self, values: Array, start: Array, count: Array) -> tuple[Array, Array, Array]:
        model, data = self._model_of(values), jax.tree.map(_own, self._data)
        q, v, force = jnp.split(start, 3)

        def step(_: Array, carry: tuple[Array, ...]) -> tuple[Array, ...]:
            state = data.replace(qpos=carry[0], qvel=carry[1], qfrc_applied=force)
            end = _stepped(model, state)
            return end.qpos, end.qvel, mjx.full_m(model, end), end.qfrc_bias

        none = jnp.zeros((self.dof, self.dof))
        q, v, mass, bias = jax.lax.fori_loop(0, count, step, (q, v, none, jnp.zeros(self.dof)))
        return jnp.concatenate([q, v]), mass, bias

    def _model_of(self, values: Array) -> Any:
        model, joint = jax.tree.map(_own, self._model), self._stopped
        end = 2 + 4 * self.dof
        mass, centre, inertia, damping = values[2:end].reshape(-1, 4).T
        inertia = jnp.maximum(inertia, LEAST_SHARE * mass * centre**2)
        down = jnp.array([0.0, 0.0, -1.0])
        model = model.replace(
            opt=model.opt.replace(timestep=values[0], gravity=values[1] * down),
            body_mass=model.body_mass.at[1:].set(mass),
            body_ipos=model.body_ipos.at[1:, 2].set(centre),
            body_inertia=model.body_inertia.at[1:].set(inertia[:, None]),
            dof_damping=damping,
        )
        if joint is None:
            return model
        limit, weight = values[end:]
        return model.replace(
            jnt_range=model.jnt_range.at[joint].set(limit * jnp.array([-1.0, 1.0])),
            dof_invweight0=model.dof_invweight0.at[joint].set(weight),
        )


def _stepped(model: Any, data: Any) -> Any:
    """`mjx.step`, traced with a Runge-Kutta tableau of its own.

    JAX 0.10 remembers by its identity what it has made of a NumPy array, whatever the width of
    floats was then: a program in float32 and one in float64 must not close over the same array.
    """
    kept = forward._RK4_A
    forward._RK4_A = kept.copy()
    try:
        return mjx.step(model, data)
    finally:
        forward._RK4_A = kept


def _own(leaf: Any) -> Array:
    """An array of JAX's, floats of its present default width."""
    return jnp.asarray(leaf, float) if leaf.dtype.kind == "f" else jnp.asarray(leaf)


_program = lru_cache(maxsize=64)(Program)


class MjxEngine(LanesEngine):
    """`mjx.step`, traced in JAX; for floats and NumPy compiled, in float64, on the CPU.

    `Euler` and `implicitfast` are symplectic Euler with joint damping taken implicitly, `RK4` is
    the classical Runge-Kutta method. MJX has none of MuJoCo's `implicit` and `discrete`.
    """

    name: ClassVar[str] = "mjx"
    package: ClassVar[str] = "mujoco-mjx"
    modules: ClassVar[tuple[str, ...]] = ("mujoco.mjx", "jax")
    batched: ClassVar[bool] = True
    maps: ClassVar[Mapping[str, str]] = {own: MAPS[own] for own in ("Euler", "implicitfast", "RK4")}

    def build(self) -> None:
        """Make the program and place the model's numbers."""
        jax = load("jax", "mjx")
        with quiet():
            load("mujoco.mjx", "mjx")

        self._jax, self._numbers = jax, numbers
        self._program, stop = program_of(self.mechanism, self.integrator), self._stop()
        with jax.enable_x64(True):
            self._values, self._still = (
                jax.device_put(np.array(numbers(self.mechanism, dt, stop)), jax.devices("cpu")[0])
                for dt in (self.dt, 0.0)
            )

    def at(self, system: PlantSystem, dt: Component) -> MjxEngine:
        """The same engine for other values of the parameters, traced or arrays of JAX's."""
        other = super().at(system, dt)
        other.mechanism = system.plant.mechanism  # type: ignore[attr-defined]
        other._damped = True
        return other

    def stop_parameters(self) -> dict[str, Any]:
        """`solref` and `solimp` of the limited joint."""
        return stop_law(self._program.made, self.system.engine_stops)

    def at_rest(self, q: Components) -> tuple[Array, Array]:
        """Mass matrix and minus the bias force, of a step that takes no time."""
        start = np.array([[*q, *(0.0,) * (2 * len(q))]])
        _, mass, bias = self._called(self._still, start, 1)
        return np.asarray(mass), -np.asarray(bias)

    def run(self, count: int) -> Run:
        """Take ``count`` steps in one call."""
        step, values, double = self._program.run, self._values, self._jax.enable_x64
        starts = np.zeros((self._program.lanes, 3 * self._program.dof))

        def run(*start: float) -> tuple[float, ...]:
            starts[0] = start
            with double(True):
                return tuple(np.asarray(step(values, starts, count, 1)[0])[0].tolist())

        return run

    def run_lanes(self, starts: Array, count: int) -> Array:
        """Take ``count`` steps, some dozens of lanes in one call."""
        size = self._program.lanes
        parts = [starts[k : k + size] for k in range(0, len(starts), size)]
        return np.concatenate([self._called(self._values, part, count)[0] for part in parts])

    def travel(
        self, ops: Ops, q: Components, v: Components, force: Components, count: int
    ) -> tuple[Components, Components, Component, Component, Component]:
        """Take ``count`` steps; q, v, and the solver's iterations, residual and convergence."""
        if not isinstance(q[0], self._jax.Array):
            return super().travel(ops, q, v, force, count)
        values = self._numbers(self.mechanism, self.dt, ())

        def step(_: Component, state: tuple[Component, ...]) -> tuple[Component, ...]:
            return self._program.step(values, (*state, *force))

        ends = ops.repeat(count, step, (*q, *v))
        return ends[: len(q)], ends[len(q) :], 0, 0.0, True

    def _stop(self) -> tuple[float, ...]:
        """Limit of the limited joint and inverse of its inertia at 0, by which MuJoCo weighs it."""
        stops, plant = self.system.engine_stops, self.system.plant
        if stops is None:
            return ()
        at_zero = plant.mass_matrix(SCALAR, (0.0,) * len(plant.coordinates))
        weight = np.linalg.inv(np.array(at_zero))[stops.coordinate, stops.coordinate]
        return stops.limit, float(weight)

    def _called(self, values: Any, starts: Array, count: int) -> tuple[Array, Any, Any]:
        """Ends of some lanes, and of the last the mass matrix and the bias force."""
        filled, used = np.zeros((self._program.lanes, starts.shape[1])), len(starts)
        filled[:used] = starts
        with self._jax.enable_x64(True):
            ends, mass, bias = self._program.run(values, filled, count, used)
            return np.asarray(ends)[:used], mass, bias
