"""The EvidenceRecord, version 3: the trace, one column per named scalar."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

from integ_gym.envs.plants.interface import state_names, state_units
from integ_gym.envs.transition import STATUS_NAMES

from .fields import SUMMARY_FIELDS, Field

_CODES = ", ".join(f"{code} {STATUS_NAMES[code]}" for code in range(-1, len(STATUS_NAMES) - 1))


def _column(
    name: str, kind: str, unit: str, meaning: str, at: str, source: str = "", frame: str = "",
    nullable: bool = True,
) -> Field:  # fmt: skip
    return Field(
        name, f"list<{kind}>", unit, meaning, group="trace", nullable=nullable, frame=frame, at=at,
        source=source or name,
    )  # fmt: skip


COMMON_TRACE: tuple[Field, ...] = (
    _column("time", "float64", "s", "time since the start", "instant"),
    _column("sensor_time", "float64", "s", "when the sensed sample was taken", "instant"),
    _column("energy", "float64", "J", "kinetic plus potential energy", "instant"),
    _column("reward", "float64", "1", "reward", "step"),
    _column("work", "float64", "J", "work of the actuator", "step", "actuator_work"),
    _column("dissipated", "float64", "J", "energy that damping took out", "step"),
    _column("clip_loss", "float64", "J", "energy that the speed limit took out", "step"),
    _column("energy_residual", "float64", "J", "energy that numerical error put in", "step"),
    _column("solver_iterations", "int32", "1", "most iterations in one integration step", "step"),
    _column("solver_status_code", "int8", "1", f"codes: {_CODES}", "step", "solver_status"),
)
"""Trace columns of every environment."""

CONTACT_TRACE: tuple[Field, ...] = (
    _column("penetration", "float64", "m, rad", "deepest penetration of a stop", "step"),
    _column("contact_force", "float64", "N, N m", "contact force of largest magnitude", "step"),
    _column("contact_loss", "float64", "J", "energy that contact took out", "step"),
    _column("constraint_violation", "float64", "m", "largest constraint violation", "step"),
)
"""Zero without stops; null where an environment's `info` does not report it."""

_FORCE_UNITS = {"m": "N", "rad": "N m"}
"""Unit of a coordinate to that of its generalized force."""


def control_fields(plant: Any) -> Iterator[Field]:
    """Commanded and applied value of every control; ``info`` has a single one without its name."""
    asked = "control asked for by the decision, after saturation and fallback"
    given = "control in force at the end of the control step"
    several = hasattr(plant, "controls")
    controls = plant.controls if several else ((plant.control_name, plant.control_unit),)
    commanded, applied = ("", "") if several else ("commanded", "control")
    for name, unit in controls:
        yield _column(f"{name}_commanded", "float64", unit, asked, "step", commanded, plant.frame)
        yield _column(f"{name}_applied", "float64", unit, given, "step", applied, plant.frame)


def contact_units(plant: Any) -> dict[str, str]:
    """Units of what is measured along the coordinate that the plant's stops are on."""
    if hasattr(plant, "controls"):
        return {}
    unit = plant.coordinate_units[getattr(plant, "stopped", 0)]
    force = _FORCE_UNITS[unit]
    return {"penetration": unit, "penetration_max": unit, "contact_force": force}


def trace_fields(plant: Any, task: Any) -> tuple[Field, ...]:
    """Trace columns of one environment.

    Args:
        plant: plant or plant class.
        task: task or task class.
    """
    units, column = contact_units(plant), partial(_column, frame=plant.frame)
    states = zip(state_names(plant), state_units(plant), strict=True)
    observations = zip(task.observation_names, task.observation_units, strict=True)
    return (
        COMMON_TRACE[0],
        *(column(name, "float64", unit, "true state", "instant") for name, unit in states),
        *(
            column(f"sensed_{name}", "float32", unit, "observation", "instant")
            for name, unit in observations
        ),
        COMMON_TRACE[1],
        *control_fields(plant),
        *COMMON_TRACE[2:],
        *(
            replace(field, frame=plant.frame, unit=units.get(field.name, field.unit))
            for field in CONTACT_TRACE
        ),
    )


def record_fields(plant: Any, task: Any) -> tuple[Field, ...]:
    """All columns of one environment's records.

    Raises:
        ValueError: if the plant or task names a component like another column.
    """
    units = {"initial_state": ", ".join(state_units(plant)), **contact_units(plant)}
    summary = tuple(
        replace(field, unit=units[field.name], frame=plant.frame) if field.name in units else field
        for field in SUMMARY_FIELDS
    )
    fields = (*summary, *trace_fields(plant, task))
    names = [field.name for field in fields]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(
            f"{plant.name}: evidence would have two columns named {', '.join(twice)}; "
            "rename the plant's or the task's component"
        )
    return fields
