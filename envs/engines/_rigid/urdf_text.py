"""A mechanism in the Unified Robot Description Format, for the engines that read it."""

from __future__ import annotations

from ...mechanics import Link, Mechanism, Stops

GROUND = "ground"
"""Name of the root link, which has no mass."""

_AXES = {"slide": "1 0 0", "hinge": "0 1 0"}
_FREE = {"slide": "prismatic", "hinge": "continuous"}
_LIMITED = {"slide": "prismatic", "hinge": "revolute"}
_UNLIMITED = 'lower="0" upper="-1" effort="0" velocity="0"'


def urdf(mechanism: Mechanism, stops: Stops | None = None) -> str:
    """The model as XML text; a joint without a limit has its lower one above its upper one.

    Args:
        mechanism: with numbers as parameters.
        stops: whose limit a joint has; or None.
    """
    limits = {} if stops is None else {stops.coordinate: stops.limit}
    parents = (GROUND, *(link.coordinate for link in mechanism.links))
    links = "".join(
        _link(link) + _joint(link, parent, limits.get(place))
        for place, (link, parent) in enumerate(zip(mechanism.links, parents, strict=False))
    )
    return f'<robot name="mechanism">{_body(GROUND, 0.0, 0.0, 0.0)}{links}</robot>'


def _link(link: Link) -> str:
    return _body(link.coordinate, link.mass, link.centre, link.inertia)


def _body(name: str, mass: float, centre: float, inertia: float) -> str:
    return (
        f'<link name="{name}"><inertial><origin xyz="0 0 {centre!r}"/><mass value="{mass!r}"/>'
        f'<inertia ixx="{inertia!r}" iyy="{inertia!r}" izz="{inertia!r}" ixy="0" ixz="0" iyz="0"/>'
        "</inertial></link>"
    )


def _joint(link: Link, parent: str, limit: float | None) -> str:
    kind = _FREE[link.joint] if limit is None else _LIMITED[link.joint]
    ends = _UNLIMITED
    if limit is not None:
        ends = f'lower="{-limit!r}" upper="{limit!r}" effort="0" velocity="0"'
    return (
        f'<joint name="{link.coordinate}_joint" type="{kind}">'
        f'<parent link="{parent}"/><child link="{link.coordinate}"/>'
        f'<axis xyz="{_AXES[link.joint]}"/><limit {ends}/>'
        f'<dynamics damping="{link.damping!r}" friction="0"/></joint>'
    )
