"""MJX's program of a plant: steps of many lanes, compiled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import mjx
from mujoco.mjx._src import forward

from ..mechanics import LEAST_SHARE, Link, Mechanism
from ..ops.ops import Component
from .mujoco_solver import translate_refusal, write_solver
from .rigid import mjcf

Array = Any


LANES = 64
"""Lanes of one call: one compiled program serves any number up to this, one after the other."""


def numbers(mechanism: Mechanism, dt: Component, stop: Sequence[Component]) -> list[Component]:
    """What a program's model is made of.

    Args:
        mechanism: five numbers for each link are taken from it.
        dt: step, s.
        stop: of a limited joint, the limit and the inverse of its inertia at 0; else empty.
    """
    links = [(x.mass, x.centre, x.inertia, x.damping, x.length) for x in mechanism.links]
    return [dt, mechanism.gravity, *(number for link in links for number in link), *stop]


def program_of(
    mechanism: Mechanism, integrator: str, solver: Mapping[str, Any], width: int
) -> Program:
    """The program that serves all mechanisms of these joints.

    Args:
        mechanism: how many joints there are, of what kind, and which has MuJoCo's own stops.
        integrator: MuJoCo's name.
        solver: settings of its solver that are not MuJoCo's defaults.
        width: bits of the floats that it is compiled for; each width has a program of its own.

    Raises:
        ValueError: for a setting that MJX does not take.
    """
    ones = (1.0,) * 4
    links = tuple(
        Link(x.coordinate, x.joint, *ones, None if x.limit is None else 1.0, 1.0, x.direction)
        for x in mechanism.links
    )
    settings = tuple(sorted(solver.items()))
    return _program(mjcf(Mechanism(links, 1.0), 1.0, integrator), settings, width)


class Program:
    """MJX's functions for a chain of joints; masses, lengths, damping and step are arguments.

    Args:
        text: a model in MuJoCo's format; see :func:`numbers` for what is replaced in it.
        solver: settings of its solver, as pairs.
        width: bits of the floats with which it is called.

    Attributes:
        made: MuJoCo's model of it.
        dof: number of joints.
        lanes: of one call.
    """

    def __init__(self, text: str, solver: tuple[tuple[str, Any], ...], width: int) -> None:
        self.made = made = mujoco.MjModel.from_xml_string(text)
        write_solver(mujoco, made, dict(solver))
        with jax.enable_x64(True), translate_refusal("MJX"):
            model, data = mjx.put_model(made, impl="jax"), mjx.make_data(made, impl="jax")
        self.dof, self.lanes, self.width = made.nv, LANES, width
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
            end = stepped(model, state)
            return end.qpos, end.qvel, mjx.full_m(model, end), end.qfrc_bias

        none = jnp.zeros((self.dof, self.dof))
        q, v, mass, bias = jax.lax.fori_loop(0, count, step, (q, v, none, jnp.zeros(self.dof)))
        return jnp.concatenate([q, v]), mass, bias

    def _model_of(self, values: Array) -> Any:
        model, joint = jax.tree.map(_own, self._model), self._stopped
        end = 2 + 5 * self.dof
        mass, centre, inertia, damping, length = values[2:end].reshape(-1, 5).T
        inertia = jnp.maximum(inertia, LEAST_SHARE * mass * centre**2)
        down = jnp.array([0.0, 0.0, -1.0])
        model = model.replace(
            opt=model.opt.replace(timestep=values[0], gravity=values[1] * down),
            body_pos=model.body_pos.at[2:, 2].set(length[:-1]),
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


def stepped(model: Any, data: Any) -> Any:
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
