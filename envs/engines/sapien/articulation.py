"""A mechanism as an articulation of PhysX, alone in a scene of SAPIEN."""

from __future__ import annotations

from math import inf, sqrt
from typing import Any, NamedTuple

from ...mechanics import Link, Mechanism, Stops
from .._stepping import load_undisturbed

SMALLEST_INERTIA = 1e-10
"""Of a point mass or a sliding body, per mass, m^2: PhysX takes none for an infinite one."""

UNCAPPED = 1e6
"""Speed at which PhysX clips, m/s or rad/s; 10 m/s and 50 rad/s where it is not set."""

_KINDS = {"slide": "prismatic", "hinge": "revolute_unwrapped"}
_AXES = {"slide": (1.0, 0.0, 0.0, 0.0), "hinge": (sqrt(0.5), 0.0, 0.0, sqrt(0.5))}
"""Rotation that turns x, the axis of PhysX's joints, into the joint's own; quaternion, w first."""


class Solver(NamedTuple):
    """PhysX's solver of joint drives and limits."""

    temporal: bool
    """Temporal Gauss-Seidel, in parts of the step, or projected Gauss-Seidel."""
    position_iterations: int
    velocity_iterations: int = 1

    def iterations(self) -> dict[str, int]:
        """As plain data."""
        return {
            "position_iterations": self.position_iterations,
            "velocity_iterations": self.velocity_iterations,
        }


class World(NamedTuple):
    """A scene, which lives for as long as it is held, and what is in it."""

    scene: Any
    system: Any
    articulation: Any


def articulated(
    mechanism: Mechanism,
    dt: float,
    solver: Solver,
    stops: Stops | None = None,
) -> World:
    """Build the mechanism in a scene of its own.

    Args:
        mechanism: with numbers as parameters.
        dt: timestep, s.
        solver: kind and iterations.
        stops: whose limit a joint has; or None.
    """
    sapien = load_undisturbed("sapien", "sapien")
    system = _system(sapien.physx, mechanism.gravity, solver)
    system.timestep = dt
    scene = sapien.Scene([system])
    builder = scene.create_articulation_builder()
    body = builder.create_link_builder()
    body.set_mass_and_inertia(1.0, sapien.Pose(), [1.0, 1.0, 1.0])
    limits = {} if stops is None else {stops.coordinate: stops.limit}
    for place, link in enumerate(mechanism.links):
        body = builder.create_link_builder(body)
        _describe(sapien.Pose, body, link, limits.get(place, inf))
    articulation = builder.build(fix_root_link=True)
    articulation.set_solver_position_iterations(solver.position_iterations)
    articulation.set_solver_velocity_iterations(solver.velocity_iterations)
    _release(articulation)
    return World(scene, system, articulation)


def _system(physx: Any, gravity: float, solver: Solver) -> Any:
    """A system of its own; what the process has configured for its systems stays."""
    theirs = physx.get_scene_config()
    own = physx.PhysxSceneConfig()
    own.gravity = [0.0, 0.0, -gravity]
    own.enable_tgs = solver.temporal
    physx.set_scene_config(own)
    try:
        return physx.PhysxCpuSystem()
    finally:
        physx.set_scene_config(theirs)


def _describe(pose: Any, body: Any, link: Link, limit: float) -> None:
    inertia = max(link.inertia, SMALLEST_INERTIA * link.mass)
    body.set_mass_and_inertia(link.mass, pose([0.0, 0.0, link.centre]), [inertia] * 3)
    axis = pose(q=_AXES[link.joint])
    body.set_joint_properties(
        _KINDS[link.joint], [[-limit, limit]], axis, axis, friction=0.0, damping=link.damping
    )


def _release(articulation: Any) -> None:
    """Take off what would act beside the mechanism: damping, friction, speed limits, sleep."""
    articulation.set_sleep_threshold(0.0)
    for link in articulation.links:
        link.linear_damping = link.angular_damping = 0.0
        link.max_linear_velocity = link.max_angular_velocity = UNCAPPED
    for joint in articulation.active_joints:
        joint.friction = 0.0
        joint.max_velocity = UNCAPPED
