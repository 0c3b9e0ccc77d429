"""Perturbations of a specification, and those that every panel checks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..values import SpecError, check_keys, list_of
from .cell import Perturbation


def standard_perturbations(setup: Any) -> tuple[Perturbation, ...]:
    """A heavier plant and a later command, of an environment that can have them.

    Args:
        setup: of its undisturbed cell.
    """
    found, arguments = [], setup.arguments()
    if "mass" in arguments:
        found.append(Perturbation("mass +20 %", {"mass": 1.2 * arguments["mass"]}))
    if "action_latency" in arguments:
        period = setup.timing.control_period
        later = arguments["action_latency"] + period
        found.append(Perturbation(f"latency +{1000.0 * period:g} ms", {"action_latency": later}))
    return tuple(found)


def perturbations_of(data: Mapping[str, Any], setup: Any) -> tuple[Perturbation, ...]:
    """Those given; where the key is left out, those of every panel."""
    if "perturbations" in data:
        return tuple(_perturbation(entry) for entry in list_of(data, "perturbations"))
    return standard_perturbations(setup)


def _perturbation(entry: Any) -> Perturbation:
    if not isinstance(entry, Mapping) or not isinstance(entry.get("environment", {}), Mapping):
        raise SpecError(
            f"every perturbation must be a table with a `name` and a table `environment`, got "
            f"{entry!r}"
        )
    check_keys("key in `perturbations`", entry, ("name", "environment"))
    if not entry.get("name") or not entry.get("environment"):
        raise SpecError("every perturbation needs a `name` and an `environment` table")
    return Perturbation(str(entry["name"]), dict(entry["environment"]))
