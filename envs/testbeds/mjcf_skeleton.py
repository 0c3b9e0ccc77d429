"""A robot's skeleton: bodies, joints and geoms as numbers, from which films are drawn."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from .mjcf_figures import feet_of

_GEOMS = ("sphere", "capsule", "ellipsoid", "cylinder", "box")
_JOINTS = ("free", "ball", "slide", "hinge")


def describe_skeleton(mujoco: Any, model: Any, coordinates: Iterable[str]) -> dict[str, Any]:
    """What a film needs of a compiled model: no mesh, and nothing that changes its motion.

    Args:
        mujoco: the module.
        model: compiled model.
        coordinates: name of each joint position.

    Returns:
        ``coordinates``; ``weight``, N; ``feet``, their bodies by name; ``floor``, height of the
        first plane, m, or None; ``bodies``, but for the world, as [parent, position, quaternion],
        with parent −1 for the world; ``joints`` as [body, kind, place among the coordinates, axis,
        position, reference]; ``geoms`` as [body, kind, sizes, position, quaternion]. In m and the
        frame of the body or parent.
    """
    geoms = {int(getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}")): kind for kind in _GEOMS}
    joints = {int(getattr(mujoco.mjtJoint, f"mjJNT_{kind.upper()}")): kind for kind in _JOINTS}
    planes = [g for g, kind in enumerate(model.geom_type) if kind == mujoco.mjtGeom.mjGEOM_PLANE]
    return {
        "coordinates": list(coordinates),
        "weight": round(float(model.body_subtreemass[0] * -model.opt.gravity[2]), 2),
        "feet": {name: body - 1 for name, body in feet_of(model).items()},
        "floor": round(float(model.geom_pos[planes[0], 2]), 4) if planes else None,
        "bodies": [
            [
                int(model.body_parentid[k]) - 1,
                *_round_vectors(model.body_pos[k], model.body_quat[k]),
            ]
            for k in range(1, model.nbody)
        ],
        "joints": [
            [
                int(model.jnt_bodyid[k]) - 1,
                joints[int(kind)],
                int(model.jnt_qposadr[k]),
                *_round_vectors(model.jnt_axis[k], model.jnt_pos[k]),
                round(float(model.qpos0[model.jnt_qposadr[k]]), 4),
            ]
            for k, kind in enumerate(model.jnt_type)
        ],
        "geoms": [
            [
                int(model.geom_bodyid[k]) - 1,
                geoms[int(kind)],
                *_round_vectors(model.geom_size[k], model.geom_pos[k], model.geom_quat[k]),
            ]
            for k, kind in enumerate(model.geom_type)
            if int(kind) in geoms
        ],
    }


def _round_vectors(*vectors: Any) -> list[list[float]]:
    return [[0.0 + round(float(x), 4) for x in vector] for vector in vectors]
