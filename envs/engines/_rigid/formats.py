"""A mechanism in the formats that simulators read, and what they take for its numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...mechanics.contact import Stops
from ...mechanics.mechanism import Link, Mechanism
from .agreement import Array

MAPS: dict[str, str] = {
    "Euler": "symplectic_euler_implicit_damping",
    "implicitfast": "symplectic_euler_implicit_damping",
    "implicit": "symplectic_euler_implicit_velocity",
    "discrete": "symplectic_euler_implicit_damping",
    "RK4": "rk4",
}
"""MuJoCo's integrators, and the one-step maps that they apply."""

LEAST_INERTIA = 1.1e-15
"""Of a body, kg m^2: MuJoCo's compiler wants more than 1e-15."""

LEAST_SHARE = 1e-12
"""A point mass's moment of inertia about itself, as a share of that about its joint."""

_AXES = {"slide": "1 0 0", "hinge": "0 1 0"}


def moment(link: Link) -> float:
    """A link's moment of inertia, kg m^2, or one above zero that makes no difference.

    For simulators that take none of zero. A sliding body never turns: any will do.
    """
    about_joint = link.mass * (link.centre**2 or 1.0)
    least: float = max(link.inertia, LEAST_SHARE * about_joint)
    return least


def mjcf(mechanism: Mechanism, dt: float, integrator: str, history: int = 0) -> str:
    """The model in MuJoCo's format, XML text; stops have MuJoCo's own parameters of contact.

    Args:
        mechanism: with numbers as parameters.
        dt: timestep, s.
        integrator: MuJoCo's name.
        history: of so many steps, the last, the data keeps the velocities of the start.
    """
    bodies = "".join(map(_opening, mechanism.links))
    sensors = "".join(
        f'<jointvel joint="{link.coordinate}" nsample="{history}"/>'
        for link in mechanism.links
        if history
    )
    return (
        '<mujoco><compiler angle="radian" autolimits="false"/>'
        f'<option timestep="{dt!r}" integrator="{integrator}" gravity="0 0 {-mechanism.gravity!r}">'
        '<flag contact="disable" autoreset="disable"/></option>'
        f"<worldbody>{bodies}{'</body>' * len(mechanism.links)}</worldbody>"
        f"<sensor>{sensors}</sensor></mujoco>"
    )


def _opening(link: Link) -> str:
    inertia, limit = max(moment(link), LEAST_INERTIA), link.limit
    ends = "" if limit is None else f'limited="true" range="{-limit!r} {limit!r}" '
    return (
        f'<body name="{link.coordinate}">'
        f'<joint name="{link.coordinate}" type="{link.joint}" axis="{_AXES[link.joint]}" '
        f'{ends}damping="{link.damping!r}"/>'
        f'<inertial pos="0 0 {link.centre!r}" mass="{link.mass!r}" '
        f'diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>'
    )


def stop_law(model: Any, stops: Stops | None) -> dict[str, Any]:
    """`solref` and `solimp` of the limited joint of a MuJoCo model."""
    assert stops is not None
    tables = {"solref": model.jnt_solref, "solimp": model.jnt_solimp}
    return {name: table[stops.coordinate].tolist() for name, table in tables.items()}


def mass_matrix(mujoco: Any, model: Any, data: Any) -> Array:
    """Of a MuJoCo model, (dof, dof), from data that hold it packed."""
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    return full


def urdf(mechanism: Mechanism) -> str:
    """The model in the Unified Robot Description Format, XML text.

    A joint without a limit has its lower one above its upper one. The root link has no mass.

    Args:
        mechanism: with numbers as parameters.
    """
    parts, parent = [_body("ground", 0.0, 0.0, 0.0)], "ground"
    for link in mechanism.links:
        parts += [_body(link.coordinate, link.mass, link.centre, link.inertia)]
        parts += [_joint(link, parent)]
        parent = link.coordinate
    return f'<robot name="mechanism">{"".join(parts)}</robot>'


def _body(name: str, mass: float, centre: float, inertia: float) -> str:
    return (
        f'<link name="{name}"><inertial><origin xyz="0 0 {centre!r}"/><mass value="{mass!r}"/>'
        f'<inertia ixx="{inertia!r}" iyy="{inertia!r}" izz="{inertia!r}" ixy="0" ixz="0" iyz="0"/>'
        "</inertial></link>"
    )


def _joint(link: Link, parent: str) -> str:
    kinds, ends = {"slide": "prismatic", "hinge": "continuous"}, 'lower="0" upper="-1"'
    if link.limit is not None:
        kinds["hinge"], ends = "revolute", f'lower="{-link.limit!r}" upper="{link.limit!r}"'
    return (
        f'<joint name="{link.coordinate}_joint" type="{kinds[link.joint]}">'
        f'<parent link="{parent}"/><child link="{link.coordinate}"/>'
        f'<axis xyz="{_AXES[link.joint]}"/><limit {ends} effort="0" velocity="0"/>'
        f'<dynamics damping="{link.damping!r}" friction="0"/></joint>'
    )
