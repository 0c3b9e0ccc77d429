"""A mechanism as Drake's `MultibodyPlant`."""

from __future__ import annotations

from math import inf
from typing import Any

from integ_gym.support import load

from ...mechanics import Link, Mechanism, Stops


def multibody_plant(
    mechanism: Mechanism, dt: float = 0.0, contact: str = "", stops: Stops | None = None
) -> Any:
    """The finalized model; with generalized forces as its only input.

    Args:
        mechanism: with numbers as parameters.
        dt: step of a discrete model, s; 0 for a continuous one.
        contact: Drake's name of the contact approximation of a discrete model.
        stops: whose limit a joint of a discrete model has, or None.
    """
    plants = load("pydrake.multibody.plant", "drake")
    plant = plants.MultibodyPlant(dt)
    if dt:
        approximations = plants.DiscreteContactApproximation.__members__
        plant.set_discrete_contact_approximation(approximations[f"k{contact.capitalize()}"])
        plant.SetUseSampledOutputPorts(False)
    parent = plant.world_frame()
    for place, link in enumerate(mechanism.links):
        limit = stops.limit if stops is not None and stops.coordinate == place else inf
        parent = _added(plant, parent, link, limit)
    plant.mutable_gravity_field().set_gravity_vector((0.0, 0.0, -mechanism.gravity))
    plant.Finalize()
    return plant


def _added(plant: Any, parent: Any, link: Link, limit: float) -> Any:
    """Hang a link on a frame; its own frame."""
    tree = load("pydrake.multibody.tree", "drake")
    inertia = tree.RotationalInertia(link.inertia, link.inertia, link.inertia)
    body = plant.AddRigidBody(
        link.coordinate,
        tree.SpatialInertia.MakeFromCentralInertia(link.mass, (0.0, 0.0, link.centre), inertia),
    )
    kind, axis = {
        "slide": (tree.PrismaticJoint, (1.0, 0.0, 0.0)),
        "hinge": (tree.RevoluteJoint, (0.0, 1.0, 0.0)),
    }[link.joint]
    frame = body.body_frame()
    plant.AddJoint(kind(link.coordinate, parent, frame, axis, -limit, limit, link.damping))
    return frame
