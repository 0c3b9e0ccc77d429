"""One line of the census, measured."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

from integ_gym.envs import numerics
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.plants.interface import join_state
from integ_gym.evidence.record import plain

from .drift import Drift, energy_drift
from .identify import Found, identify
from .speed_limit import SpeedLimit, find_speed_limit
from .subjects.subject import Subject

SAME_TIME = 1e-5
"""Relative difference up to which two times are the same."""

DRAWN = 100
"""Intervals between the energies of a free motion that are kept."""


@dataclass(frozen=True)
class Line:
    """What was found of a subject.

    Attributes:
        subject: what was looked at, and is held no longer: engines may be processes.
        found: what its control period is made of.
        speed_limit: None where nothing was identified that it could be told from.
        drift: None where a free motion cannot be had.
        swing_period: of small oscillations about hanging, s.
        authority: largest control over the largest torque of gravity, or over the weight.
    """

    subject: Subject
    found: Found
    speed_limit: SpeedLimit | None
    drift: Drift | None
    swing_period: float
    authority: float

    @property
    def differences(self) -> tuple[str, ...]:
        """In what it is not what it is said to be, as sentences."""
        return tuple(_differences(self))

    def to_json(self) -> dict[str, Any]:
        """As plain data; what is not finite is null."""
        subject, plant = self.subject, self.subject.plant
        names = ("source", "name", "version", "published")
        line: dict[str, Any] = {
            **{name: getattr(subject, name) for name in names},
            "plant": plant.name,
            "parameters": {f.name: getattr(plant, f.name) for f in fields(plant)},  # type: ignore[arg-type]
            "swing_period": self.swing_period,
            "max_control": subject.max_control,
            "authority": self.authority,
            "width": subject.width,
            "note": subject.note,
            "stated": {**asdict(subject.stated), "dt": subject.stated.dt},
            "found": asdict(self.found),
            "speed_limit": self.speed_limit and asdict(self.speed_limit),
            "drift": self.drift and _drift(self.drift),
            "differences": self.differences,
        }
        return {name: plain(value) for name, value in line.items()}


def measure(subject: Subject) -> Line:
    """Look at a subject."""
    plant: Any = subject.plant
    access = subject.access
    assert access is not None
    found = identify(access.samples(subject), subject.stated, subject.width)
    states = access.coast(subject)
    limit = find_speed_limit(access.driven(subject), found) if found.identified else None
    free = replace(plant, **dict.fromkeys(numerics.damping_parameters(plant), 0.0))
    n = len(plant.coordinates)
    hanging = join_state((*(0.0,) * (n - 1), math.pi), (0.0,) * n)
    return Line(
        subject=replace(subject, access=None),
        found=found,
        speed_limit=limit,
        drift=energy_drift(plant, states, subject.stated.control_period) if states else None,
        swing_period=math.tau / numerics.fastest_rate(free, hanging),
        authority=subject.max_control / _weight(plant),
    )


def _weight(plant: Any) -> float:
    """Largest torque of gravity at the pendulum's hinge, N m; weight of the cart-pole, N."""
    n = len(plant.coordinates)
    level, still = (*(0.0,) * (n - 1), 0.5 * math.pi), (0.0,) * n
    mass = plant.mass_matrix(SCALAR, level)
    if n == 1:
        return float(mass[0][0] * plant.acceleration(SCALAR, level, still, still)[0])
    return float(mass[0][0] * plant.gravity)


def _differences(line: Line) -> list[str]:
    found, stated = line.found, line.subject.stated
    if not found.identified:
        return [
            f"no known map: the nearest, {found.map}, is {found.defect:.0e} off in one control "
            "period"
        ]
    said = []
    if stated.map is not None and stated.map not in found.equal_maps:
        said.append(f"said to be {stated.map}, is {found.map}")
    if abs(found.control_period / stated.control_period - 1.0) > SAME_TIME:
        said.append(
            f"said to take {stated.control_period:g} s a control period, takes "
            f"{found.control_period:.4g} s"
        )
    elif found.substeps != stated.substeps:
        said.append(
            f"said to take {stated.substeps} steps a control period, takes {found.substeps}"
        )
    return [*said, *_limit_differences(line)]


def _limit_differences(line: Line) -> list[str]:
    limit, stated = line.speed_limit, line.subject.stated.max_speed
    if limit is None:
        return []
    if limit.slowed:
        return ["is slower than its map at high speeds"]
    if stated is None and limit.limit is not None:
        return [f"cuts speeds at {limit.limit:.4g} without saying so"]
    if stated is not None and limit.limit is None and limit.fastest > stated:
        return [f"said to cut speeds at {stated:g}, does not"]
    if limit.moves_by == "uncut":
        return ["moves by the velocity from before its speed limit"]
    return []


def _drift(drift: Drift) -> dict[str, Any]:
    """With every so many of its energies, in the digits that a curve shows."""
    every = max(1, math.ceil((len(drift.energies) - 1) / DRAWN))
    curves = {name: getattr(drift, name)[::every] for name in ("energies", "exact_energies")}
    return {**asdict(drift), **plain(curves, 5)}
