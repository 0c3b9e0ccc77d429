"""What may be chosen for a MuJoCo task, and what it is made of, as integ-gym says of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from integ_gym.support.packages.extras import load
from integ_gym.support.packages.versions import package_version
from integ_gym.support.parameters import (
    check_values,
    finite_number,
    parameter,
    positive,
    text,
    unknown_name,
)

from ...episode.timing import check_divides
from ..foreign import ForeignPlant

_PLACE = (("_x", "m"), ("_y", "m"), ("_z", "m"))
_ATTITUDE = (("_qw", "1"), ("_qx", "1"), ("_qy", "1"), ("_qz", "1"))
_VELOCITY = (("_vx", "m/s"), ("_vy", "m/s"), ("_vz", "m/s"))
_SPIN = (("_wx", "rad/s"), ("_wy", "rad/s"), ("_wz", "rad/s"))
_JOINTS = {
    "slide": ((("", "m"),), (("_dot", "m/s"),)),
    "hinge": ((("", "rad"),), (("_dot", "rad/s"),)),
    "ball": (_ATTITUDE, _SPIN),
    "free": (_PLACE + _ATTITUDE, _VELOCITY + _SPIN),
}
"""By kind of joint: what is put to its name, and the unit, of each coordinate and velocity."""


@dataclass(frozen=True)
class Choice:
    """The arguments of :func:`integ_gym.rediscretize`; None leaves the task as it is.

    Raises:
        ValueError: for a value of another kind or range, with what was expected.
    """

    integrator: str | None = parameter(None, "", "MuJoCo's name", text)
    dt: float | None = parameter(None, "s", "timestep", positive)
    success_return: float | None = parameter(None, "", "return of a success", finite_number)

    def __post_init__(self) -> None:
        check_values(Choice, {name: x for name, x in vars(self).items() if x is not None})

    def step_of(self, model: Any, period: float) -> float:
        """The timestep, s.

        Raises:
            ValueError: if the control period ``period``, s, is no whole multiple of it.
        """
        step = float(model.opt.timestep) if self.dt is None else float(self.dt)
        check_divides("dt", step, "the control period", period)
        return step

    def integrator_of(self, model: Any) -> str:
        """MuJoCo's name of the integrator.

        Raises:
            ValueError: for one that MuJoCo lacks, with those it has.
        """
        known = integrator_numbers()
        if self.integrator is None:
            return next(own for own, number in known.items() if number == model.opt.integrator)
        if self.integrator not in known:
            raise ValueError(unknown_name("integrator of MuJoCo", self.integrator, known))
        return self.integrator


def integrator_numbers() -> dict[str, int]:
    """Integrators of the installed MuJoCo by the names that its model files use."""
    members = load("mujoco", "mujoco").mjtIntegrator.__members__.values()
    capitals = {"euler": "Euler", "rk4": "RK4"}
    names = [member.name.removeprefix("mjINT_").lower() for member in members]
    return {capitals.get(n, n): int(m) for n, m in zip(names, members, strict=True)}


@dataclass(frozen=True)
class ModelEngine:
    """MuJoCo on the task's own model."""

    integrator: str
    tolerance: float
    cap: int
    accounted: bool
    width: int = 64
    reports: bool = True

    @property
    def version(self) -> str:
        """MuJoCo's version."""
        return package_version("mujoco") or "unknown"

    def solver(self) -> dict[str, Any]:
        """Tolerance and iteration cap of the constraint solver."""
        return {"solver_tolerance": self.tolerance, "solver_cap": self.cap}

    def describe(self) -> dict[str, Any]:
        """Float width, and whether the ledger knows every loss where no constraint acts."""
        return {"width": self.width, "losses_accounted": self.accounted}


def plant_of(mujoco: Any, model: Any, name: str) -> ForeignPlant:
    """Names and units of a compiled model's state and controls."""
    kinds = {int(getattr(mujoco.mjtJoint, f"mjJNT_{k.upper()}")): x for k, x in _JOINTS.items()}
    of_q, of_v = [], []
    for index in range(model.njnt):
        joint = model.joint(index).name or f"joint{index}"
        coordinates, velocities = kinds[int(model.jnt_type[index])]
        of_q += [(f"{joint}{suffix}", unit) for suffix, unit in coordinates]
        of_v += [(f"{joint}{suffix}", unit) for suffix, unit in velocities]
    names, units = zip(*of_q, strict=True)
    rates, rate_units = zip(*of_v, strict=True)
    return ForeignPlant(
        name, tuple(_controls(mujoco, model)), names, units, rates, rate_units, "the model's joints"
    )


def _controls(mujoco: Any, model: Any) -> list[tuple[str, str]]:
    """Name of every actuator, or of its joint; MuJoCo's control has no unit before its gear."""
    on_joint = int(mujoco.mjtTrn.mjTRN_JOINT)
    names: list[str] = []
    for index in range(model.nu):
        name = model.actuator(index).name
        if not name and int(model.actuator_trntype[index]) == on_joint:
            name = model.joint(int(model.actuator_trnid[index, 0])).name
        names.append(name if name and name not in names else f"{name or 'actuator'}{index}")
    return [(f"{name}_control", "1") for name in names]
