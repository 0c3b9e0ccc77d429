"""SAPIEN: NVIDIA's PhysX 5."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from ...arithmetic import SCALAR, Components
from ...mechanics import Mechanism
from .._rigid import PROBES, TOLERANCE, Array, HeldForce, RigidBodyEngine
from .._stepping import Run
from .articulation import Solver, World, articulated

SOLVERS = {"tgs": Solver(True, 10), "pgs": Solver(False, 50)}
"""Temporal Gauss-Seidel as SAPIEN has it by default; projected Gauss-Seidel until it converges."""


class SapienEngine(RigidBodyEngine):
    """PhysX articulations on the CPU, in float32: symplectic Euler, damped by PhysX's solver.

    `tgs` (SAPIEN's default, ten position iterations) drifts in ten parts and damps one joint after
    another before each; `pgs` takes joint damping implicitly. PhysX's own link damping, joint
    friction, speed limits and sleep are switched off. SAPIEN's import sets environment variables
    that its renderer wants, which are taken back: a program that renders with it imports it first.

    Raises:
        ValueError: if PhysX's solver does not converge on the plant's damping, in addition to what
            engines of rigid bodies refuse.
    """

    name: ClassVar[str] = "sapien"
    package: ClassVar[str] = "sapien"
    modules: ClassVar[tuple[str, ...]] = ("sapien",)
    width: ClassVar[int] = 32
    own_stops: ClassVar[bool] = True
    maps: ClassVar[Mapping[str, str]] = {
        "tgs": "symplectic_euler_sequential_damping",
        "pgs": "symplectic_euler_implicit_damping",
    }

    def build(self) -> None:
        """Build the articulation; beside it one without stops, and one without weight."""
        solver, stops = SOLVERS[self.integrator], self.system.engine_stops
        links = tuple(replace(link, damping=0.0) for link in self.mechanism.links)
        self._world = articulated(self.mechanism, self.dt, solver, stops)
        self._free = articulated(self.mechanism, self.dt, solver)
        self._weightless = articulated(Mechanism(links, 0.0), self.dt, solver)

    def describe(self) -> dict[str, Any]:
        """As every engine, and the solver's iterations."""
        return {**super().describe(), **SOLVERS[self.integrator].iterations()}

    def stop_parameters(self) -> dict[str, Any]:
        """PhysX's limits are hard: the solver is all there is."""
        return {"solver": self.integrator, **SOLVERS[self.integrator].iterations()}

    def inertia(self, q: Components) -> Array:
        """Inverse of the velocities that impulses give, at rest and without weight.

        The impulses are such that joints alone would move at 1 m/s or rad/s.
        """
        _, system, articulation = self._weightless
        impulses = np.diag(np.diag(self.system.plant.mass_matrix(SCALAR, q)))
        columns = []
        for impulse in impulses:
            _put(articulation, q, (0.0,) * len(q), impulse / self.dt)
            system.step()
            columns.append(articulation.get_qvel().astype(np.float64))
        return impulses @ np.linalg.inv(np.stack(columns, axis=1))

    def gravity(self, q: Components) -> Array:
        """Minus the force that holds it at rest."""
        articulation = self._free.articulation
        _put(articulation, q, (0.0,) * len(q), (0.0,) * len(q))
        held = articulation.compute_passive_force(gravity=True, coriolis_and_centrifugal=False)
        return -np.asarray(held, np.float64)

    def run(self, count: int) -> Run:
        """Set the state and the force, which stays, and step ``count`` times."""
        return _run_in(self._world, len(self.mechanism.links), count)

    def _check(self) -> None:
        super()._check()
        n = len(self.mechanism.links)
        for q in (0.0,) * n, *[probe[-n:] for probe in PROBES]:
            for v in [probe[-n:] for probe in PROBES]:
                self._compare(q, v)

    def _compare(self, q: Components, v: Components) -> None:
        """Compare one step with the map.

        Raises:
            ValueError: if they differ.
        """
        force = (0.0,) * len(q)
        held = HeldForce(self.system.plant, force)
        told = self._map.step(SCALAR, held, q, v, (0.0,), 0.0, self.dt)
        expected = np.array((*told.q, *told.v))
        got = np.array(_run_in(self._free, len(q), 1)(*q, *v, *force))
        if (np.abs(got - expected) > TOLERANCE[self.width] * (1.0 + np.abs(expected))).any():
            raise ValueError(
                f"engine 'sapien' with integrator {self.integrator!r} is not the map {self.map!r} "
                "on this plant, whose damping its solver does not resolve in "
                f"{SOLVERS[self.integrator].position_iterations} iterations; give a smaller `dt` "
                "or less damping, or integrator 'tgs'"
            )


def _run_in(world: World, n: int, count: int) -> Run:
    def run(*values: float) -> tuple[float, ...]:
        _, system, articulation = world
        _put(articulation, values[:n], values[n : 2 * n], values[2 * n :])
        for _ in range(count):
            system.step()
        return (*articulation.get_qpos().tolist(), *articulation.get_qvel().tolist())

    return run


def _put(articulation: Any, q: Any, v: Any, force: Any) -> None:
    articulation.set_qpos(q)
    articulation.set_qvel(v)
    articulation.set_qf(force)
