"""SAPIEN: the plant as an articulation of NVIDIA's PhysX 5."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import inf, sqrt
from typing import Any, ClassVar, NamedTuple

import numpy as np

from integ_gym.support.errors import InputError

from ..mechanics import Mechanism
from ..ops.ops import SCALAR, Components
from .rigid import TOLERANCE, Array, HeldForce, RigidBodyEngine, joint_masses, probes
from .simulator import Run, load_undisturbed

SOLVERS = {
    "tgs": {"position_iterations": 10, "velocity_iterations": 1},
    "pgs": {"position_iterations": 50, "velocity_iterations": 1},
}
"""Temporal Gauss-Seidel as SAPIEN has it by default; projected Gauss-Seidel until it converges."""

SMALLEST_INERTIA = 1e-10
"""Of a point mass or a sliding body, per mass, m^2: PhysX takes none for an infinite one."""

UNCAPPED = 1e6
"""Speed at which PhysX clips, m/s or rad/s; 10 m/s and 50 rad/s where it is not set."""

_KINDS = {"slide": "prismatic", "hinge": "revolute_unwrapped"}
_AXES = {
    (1, 0, 0): (1.0, 0.0, 0.0, 0.0),
    (0, 1, 0): (sqrt(0.5), 0.0, 0.0, sqrt(0.5)),
    (0, -1, 0): (sqrt(0.5), 0.0, 0.0, -sqrt(0.5)),
    (0, 0, 1): (sqrt(0.5), 0.0, -sqrt(0.5), 0.0),
    (0, 0, -1): (sqrt(0.5), 0.0, sqrt(0.5), 0.0),
}
"""Rotation that turns x, the axis of PhysX's joints, into the joint's own; quaternion, w first."""


class World(NamedTuple):
    """A scene, which lives for as long as it is held, and what is in it."""

    scene: Any
    system: Any
    articulation: Any


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
    width: int = 32
    maps: ClassVar[Mapping[str, str]] = {
        "tgs": "symplectic_euler_sequential_damping",
        "pgs": "symplectic_euler_implicit_damping",
    }
    zero_settings: ClassVar[tuple[str, ...]] = ("velocity_iterations",)
    solver_defaults: ClassVar[Mapping[str, Mapping[str, Any]]] = SOLVERS

    def build(self) -> None:
        """Build the articulation; beside it one without stops, and one without weight."""
        undamped = tuple(replace(link, damping=0.0) for link in self.free.links)
        self._world = self._build_articulation(self.mechanism)
        self._free = self._build_articulation(self.free)
        self._weightless = self._build_articulation(Mechanism(undamped, 0.0))

    def stop_parameters(self) -> dict[str, Any]:
        """PhysX's limits are hard: the solver is all there is."""
        return {"solver": self.integrator, **self.settings}

    def at_rest(self, q: Components) -> tuple[Array, Array]:
        """Mass matrix, and minus the force that holds it.

        The matrix is measured by impulses without weight, under which the plant would move one
        coordinate at a time, at 1 m/s or rad/s. The matrix of velocities is then near the
        identity, and inverting it loses no digits.
        """
        _, system, articulation = self._weightless
        still = (0.0,) * len(q)
        impulses = joint_masses(self.system.plant, q)
        columns = []
        for impulse in impulses.T:
            _put(articulation, q, still, impulse / self.dt)
            system.step()
            columns.append(articulation.get_qvel().astype(np.float64))
        free = self._free.articulation
        _put(free, q, still, still)
        held = free.compute_passive_force(gravity=True, coriolis_and_centrifugal=False)
        return impulses @ np.linalg.inv(np.stack(columns, axis=1)), -np.asarray(held, np.float64)

    def run(self, count: int) -> Run:
        """Set the state and the force, which stays, and step ``count`` times."""
        return _run_in(self._world, len(self.mechanism.links), count)

    def _build_articulation(self, mechanism: Mechanism) -> World:
        """The mechanism in a scene of its own."""
        sapien, iterations = load_undisturbed("sapien", "sapien"), self.settings
        system = _system(sapien.physx, mechanism.gravity, self.integrator == "tgs")
        system.timestep = self.dt
        scene = sapien.Scene([system])
        builder = scene.create_articulation_builder()
        body = builder.create_link_builder()
        body.set_mass_and_inertia(1.0, sapien.Pose(), [1.0, 1.0, 1.0])
        for link, offset in zip(mechanism.links, mechanism.offsets, strict=True):
            body = builder.create_link_builder(body)
            inertia = max(link.inertia, SMALLEST_INERTIA * link.mass)
            centre = sapien.Pose([0.0, 0.0, link.centre])
            body.set_mass_and_inertia(link.mass, centre, [inertia] * 3)
            axis = sapien.Pose(q=_AXES[link.axis])
            place = sapien.Pose([0.0, 0.0, offset], _AXES[link.axis])
            limit = inf if link.limit is None else link.limit
            body.set_joint_properties(
                _KINDS[link.joint], [[-limit, limit]], place, axis, friction=0.0,
                damping=link.damping,
            )  # fmt: skip
        articulation = builder.build(fix_root_link=True)
        articulation.set_solver_position_iterations(iterations["position_iterations"])
        articulation.set_solver_velocity_iterations(iterations["velocity_iterations"])
        _release(articulation)
        return World(scene, system, articulation)

    def _check(self) -> None:
        super()._check()
        size = len(self.system.plant.coordinates)
        slack = [link.slack for link in self.mechanism.links]
        for q in ((*slack, *(0.0,) * (size - len(slack))), *probes(size)):
            for v in probes(size):
                self._compare(q, v)

    def _compare(self, q: Components, v: Components) -> None:
        """Compare one step with the map.

        Raises:
            ValueError: if they differ.
        """
        force = (0.0,) * len(q)
        held = HeldForce(self.system.plant, force)
        step = self._map.step(SCALAR, held, q, v, (0.0,), 0.0, self.dt)
        n, pulls = len(self.mechanism.links), self.with_springs(q, force)
        expected = np.array((*step.q[:n], *step.v[:n]))
        got = np.array(_run_in(self._free, n, 1)(*q[:n], *v[:n], *pulls[:n]))
        if (np.abs(got - expected) > TOLERANCE[self.width] * (1.0 + np.abs(expected))).any():
            raise InputError(
                f"engine 'sapien' with integrator {self.integrator!r} is not the map {self.map!r} "
                "on this plant, whose damping its solver does not resolve in "
                f"{self.settings['position_iterations']} iterations; give a smaller "
                "`dt` or less damping, or integrator 'tgs'"
            )


def _system(physx: Any, gravity: float, temporal: bool) -> Any:
    """A system of its own; what the process has configured for its systems stays."""
    theirs = physx.get_scene_config()
    own = physx.PhysxSceneConfig()
    own.gravity = [0.0, 0.0, -gravity]
    own.enable_tgs = temporal
    physx.set_scene_config(own)
    try:
        return physx.PhysxCpuSystem()
    finally:
        physx.set_scene_config(theirs)


def _release(articulation: Any) -> None:
    """Take off what would act beside the mechanism: damping, friction, speed limits, sleep."""
    articulation.set_sleep_threshold(0.0)
    for link in articulation.links:
        link.linear_damping = link.angular_damping = 0.0
        link.max_linear_velocity = link.max_angular_velocity = UNCAPPED
    for joint in articulation.active_joints:
        joint.friction = 0.0
        joint.max_velocity = UNCAPPED


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
