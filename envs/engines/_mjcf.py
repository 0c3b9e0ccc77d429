"""A mechanism in MuJoCo's model format, for the engines that read it."""

from __future__ import annotations

from integ_gym.envs.contact import Stops
from integ_gym.envs.mechanism import Link, Mechanism

SMALLEST_INERTIA = 1e-12
"""Of a point mass or a sliding body, kg m²: MuJoCo wants one above zero."""

_AXES = {"slide": "1 0 0", "hinge": "0 1 0"}


def mjcf(
    mechanism: Mechanism,
    dt: float,
    integrator: str,
    stops: Stops | None = None,
    least: float = SMALLEST_INERTIA,
) -> str:
    """The model as XML text.

    Args:
        mechanism: with numbers as parameters.
        dt: timestep, s.
        integrator: MuJoCo's name.
        stops: whose limit a joint has, with MuJoCo's own parameters of contact; or None.
        least: smallest moment of inertia, kg m².
    """
    limits = {} if stops is None else {stops.coordinate: stops.limit}
    bodies = "".join(
        _opening(link, least, limits.get(place)) for place, link in enumerate(mechanism.links)
    )
    return (
        '<mujoco><compiler angle="radian" autolimits="false"/>'
        f'<option timestep="{dt!r}" integrator="{integrator}" gravity="0 0 {-mechanism.gravity!r}">'
        '<flag contact="disable" autoreset="disable"/></option>'
        f"<worldbody>{bodies}{'</body>' * len(mechanism.links)}</worldbody></mujoco>"
    )


def _opening(link: Link, least: float, limit: float | None) -> str:
    inertia = max(link.inertia, least)
    ends = "" if limit is None else f'limited="true" range="{-limit!r} {limit!r}" '
    return (
        f'<body name="{link.coordinate}">'
        f'<joint name="{link.coordinate}" type="{link.joint}" axis="{_AXES[link.joint]}" '
        f'{ends}damping="{link.damping!r}"/>'
        f'<inertial pos="0 0 {link.centre!r}" mass="{link.mass!r}" '
        f'diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>'
    )
