"""A mechanism in MuJoCo's model format, for the engines that read it."""

from __future__ import annotations

from ...mechanics import Link, Mechanism, Stops
from .moments import moment

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

_AXES = {"slide": "1 0 0", "hinge": "0 1 0"}


def mjcf(
    mechanism: Mechanism,
    dt: float,
    integrator: str,
    stops: Stops | None = None,
    history: int = 0,
) -> str:
    """The model as XML text.

    Args:
        mechanism: with numbers as parameters.
        dt: timestep, s.
        integrator: MuJoCo's name.
        stops: whose limit a joint has, with MuJoCo's own parameters of contact; or None.
        history: of so many steps, the last, the data keeps the velocities of the start.
    """
    limits = {} if stops is None else {stops.coordinate: stops.limit}
    bodies = "".join(
        _opening(link, limits.get(place)) for place, link in enumerate(mechanism.links)
    )
    sensors = "".join(_speedometer(link, history) for link in mechanism.links if history)
    return (
        '<mujoco><compiler angle="radian" autolimits="false"/>'
        f'<option timestep="{dt!r}" integrator="{integrator}" gravity="0 0 {-mechanism.gravity!r}">'
        '<flag contact="disable" autoreset="disable"/></option>'
        f"<worldbody>{bodies}{'</body>' * len(mechanism.links)}</worldbody>"
        f"<sensor>{sensors}</sensor></mujoco>"
    )


def _speedometer(link: Link, history: int) -> str:
    return f'<jointvel joint="{link.coordinate}" nsample="{history}"/>'


def _opening(link: Link, limit: float | None) -> str:
    inertia = max(moment(link), LEAST_INERTIA)
    ends = "" if limit is None else f'limited="true" range="{-limit!r} {limit!r}" '
    return (
        f'<body name="{link.coordinate}">'
        f'<joint name="{link.coordinate}" type="{link.joint}" axis="{_AXES[link.joint]}" '
        f'{ends}damping="{link.damping!r}"/>'
        f'<inertial pos="0 0 {link.centre!r}" mass="{link.mass!r}" '
        f'diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>'
    )
