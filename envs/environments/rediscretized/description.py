"""What a MuJoCo task is made of, in the terms in which integ-gym describes its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from gymnasium import spaces

from integ_gym.support import package_version

from ...episode import Settings, Timing

_FREE = ("x", "y", "z", "qw", "qx", "qy", "qz")
_FREE_UNITS = ("m", "m", "m", "1", "1", "1", "1")
_FREE_RATES = ("vx", "vy", "vz", "wx", "wy", "wz")
_FREE_RATE_UNITS = ("m/s", "m/s", "m/s", "rad/s", "rad/s", "rad/s")
_BALL = ("qw", "qx", "qy", "qz")
_BALL_RATES = ("wx", "wy", "wz")
_UNITS = {"slide": "m", "hinge": "rad"}


@dataclass(frozen=True)
class ModelPlant:
    """A MuJoCo model's state and controls, named after its joints and actuators."""

    name: str
    coordinates: tuple[str, ...]
    coordinate_units: tuple[str, ...]
    velocities: tuple[str, ...]
    velocity_units: tuple[str, ...]
    controls: tuple[tuple[str, str], ...]
    """Name and unit of each actuator's control."""
    frame: str = "the model's joints"


@dataclass(frozen=True)
class TaskGoal:
    """What the task asks, as far as it is told apart in evidence."""

    goal: str
    observation_names: tuple[str, ...]
    observation_units: tuple[str, ...]
    discrete: None = None
    goal_stay: float = 0.0


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


@dataclass(frozen=True)
class TaskSetup:
    """The counterpart of :class:`integ_gym.envs.episode.settings.Setup` for a MuJoCo task."""

    settings: Settings
    timing: Timing
    plant: ModelPlant
    task: TaskGoal
    engine: ModelEngine
    action_space: spaces.Space[Any]
    environment: tuple[tuple[str, Any], ...]
    """Constructor arguments of the task."""
    fingerprinted: str = "cart_pole"
    """The plant on which the integrator's fingerprint is taken."""

    def arguments(self) -> dict[str, Any]:
        """Discretization and constructor arguments."""
        chosen = ("engine", "integrator", "dt", "control_period", "duration")
        return {**{n: getattr(self.settings, n) for n in chosen}, **dict(self.environment)}

    def units(self) -> dict[str, str]:
        """SI unit of every argument; empty where the task does not state one."""
        seconds = ("dt", "control_period", "duration")
        return {name: "s" if name in seconds else "" for name in self.arguments()}


def plant_of(mujoco: Any, model: Any, name: str) -> ModelPlant:
    """Names and units of a compiled model's state and controls."""
    coordinates, units, rates, rate_units = [], [], [], []
    kinds = {int(getattr(mujoco.mjtJoint, f"mjJNT_{k.upper()}")): k for k in _JOINTS}
    for index in range(model.njnt):
        joint = model.joint(index).name or f"joint{index}"
        of_q, of_v = _JOINTS[kinds[int(model.jnt_type[index])]](joint)
        coordinates += [n for n, _ in of_q]
        units += [u for _, u in of_q]
        rates += [n for n, _ in of_v]
        rate_units += [u for _, u in of_v]
    return ModelPlant(
        name, tuple(coordinates), tuple(units), tuple(rates), tuple(rate_units),
        tuple(_controls(mujoco, model)),
    )  # fmt: skip


def observation_names(size: int) -> tuple[str, ...]:
    """Names of a task's observations, which Gymnasium numbers only."""
    return tuple(f"obs{index}" for index in range(size))


def _numbered(joint: str, names: Sequence[str], units: Sequence[str]) -> list[tuple[str, str]]:
    return [(f"{joint}_{name}", unit) for name, unit in zip(names, units, strict=True)]


def _single(kind: str) -> Any:
    unit = _UNITS[kind]
    return lambda joint: ([(joint, unit)], [(f"{joint}_dot", f"{unit}/s")])


_JOINTS = {
    "slide": _single("slide"),
    "hinge": _single("hinge"),
    "ball": lambda joint: (
        _numbered(joint, _BALL, ("1",) * 4),
        _numbered(joint, _BALL_RATES, ("rad/s",) * 3),
    ),
    "free": lambda joint: (
        _numbered(joint, _FREE, _FREE_UNITS),
        _numbered(joint, _FREE_RATES, _FREE_RATE_UNITS),
    ),
}


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
