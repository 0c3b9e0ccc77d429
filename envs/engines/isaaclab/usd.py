"""A mechanism in Universal Scene Description, text."""

from __future__ import annotations

from math import pi

from ...mechanics.mechanism import Link, Mechanism
from .._rigid.formats import moment

ROOT = "mechanism"
"""Name of the prim that holds the bodies."""

LEAST_INERTIA = 1.1e-10
"""Of a body, kg m^2: Newton raises what is below 1e-10 by 1e-6."""

_JOINTS = {"slide": ("Prismatic", "X"), "hinge": ("Revolute", "Y")}


def usd(mechanism: Mechanism) -> str:
    """An articulation without shapes, whose ground is fixed to the world.

    Joints have no drive and no limit. Gravity is the scene's, and not in here.

    Args:
        mechanism: with numbers as parameters.
    """
    parts = [_body("ground", 1.0, 0.0, 1.0), _joint("Fixed", "ground_joint", None, "ground")]
    parent = "ground"
    for link in mechanism.links:
        turns = link.joint == "hinge"
        inertia = max(moment(link), LEAST_INERTIA) if turns else link.mass  # which never turns
        parts += [_body(link.coordinate, link.mass, link.centre, inertia), _moving(link, parent)]
        parent = link.coordinate
    return (
        f'#usda 1.0\n(\n    defaultPrim = "{ROOT}"\n    kilogramsPerUnit = 1\n'
        '    metersPerUnit = 1\n    upAxis = "Z"\n)\n'
        f'def Xform "{ROOT}" (prepend apiSchemas = ["PhysicsArticulationRootAPI"])\n'
        f"{{\n{''.join(parts)}}}\n"
    )


def _body(name: str, mass: object, centre: object, inertia: object) -> str:
    return (
        f'    def Xform "{name}" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"])\n'
        f"    {{\n        float physics:mass = {mass!r}\n"
        f"        point3f physics:centerOfMass = (0, 0, {centre!r})\n"
        f"        float3 physics:diagonalInertia = ({inertia!r}, {inertia!r}, {inertia!r})\n"
        "        quatf physics:principalAxes = (1, 0, 0, 0)\n    }\n"
    )


def _moving(link: Link, parent: str) -> str:
    kind, axis = _JOINTS[link.joint]
    per_degree = pi / 180.0 if link.joint == "hinge" else 1.0
    return _joint(
        kind,
        f"{link.coordinate}_joint",
        parent,
        link.coordinate,
        f'        uniform token physics:axis = "{axis}"\n'
        f"        float newton:damping = {link.damping * per_degree!r}\n",
    )


def _joint(kind: str, name: str, parent: str | None, child: str, more: str = "") -> str:
    body0 = "" if parent is None else f"        rel physics:body0 = </{ROOT}/{parent}>\n"
    return (
        f'    def Physics{kind}Joint "{name}"\n    {{\n{body0}'
        f"        rel physics:body1 = </{ROOT}/{child}>\n{more}    }}\n"
    )
