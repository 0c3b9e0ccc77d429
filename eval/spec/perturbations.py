"""Perturbations of a specification, and those that every panel checks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from integ_gym.envs.registration import environment_setup
from integ_gym.eval.cells import Perturbation, dividing_step
from integ_gym.eval.spec.values import SpecError, check_keys, list_of, table


def standard_perturbations(env_id: str, arguments: Mapping[str, Any]) -> tuple[Perturbation, ...]:
    """A heavier plant, where it has a `mass`, and a later command: what every panel checks.

    Args:
        env_id: environment.
        arguments: constructor arguments of an undisturbed cell.
    """
    setup = environment_setup(env_id, {**arguments, "dt": dividing_step(arguments)})
    period = setup.timing.control_period
    later = setup.settings.action_latency + period
    mass = setup.arguments().get("mass")
    heavier = () if mass is None else (Perturbation("mass +20 %", {"mass": 1.2 * mass}),)
    return *heavier, Perturbation(f"latency +{1000.0 * period:g} ms", {"action_latency": later})


def perturbations_of(data: Mapping[str, Any], period: float) -> tuple[Perturbation, ...]:
    """Those given; where the key is left out, those of every panel."""
    if "perturbations" in data:
        return tuple(_perturbation(entry) for entry in list_of(data, "perturbations"))
    return standard_perturbations(str(data["env_id"]), undisturbed(data, period))


def undisturbed(data: Mapping[str, Any], period: float) -> dict[str, Any]:
    """Constructor arguments of the undisturbed cell on the reference."""
    given = {"control_period": period, "dt": period, **table(data, "environment")}
    return {**given, "integrator": "reference"}


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
