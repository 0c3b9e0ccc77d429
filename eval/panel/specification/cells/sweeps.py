"""Sweeps: one constructor argument over several values, a curve for every row."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from integ_gym.envs.environment import is_integ_environment
from integ_gym.envs.settings import DISCRETIZATION

from ..values import SpecError, check_keys, check_known, check_unique, list_of, text
from .cell import Perturbation


@dataclass(frozen=True)
class Sweep:
    """A constructor argument, the values that it takes, ascending, and their unit."""

    argument: str
    values: tuple[float, ...]
    unit: str

    def perturbations(self, nominal: Any) -> tuple[Perturbation, ...]:
        """One for each value but the undisturbed one, whose cells there are already.

        Args:
            nominal: setup of the undisturbed task.
        """
        own = float(nominal.arguments()[self.argument] or 0.0)
        return tuple(
            Perturbation(swept_name(self.argument, value), {self.argument: value})
            for value in self.values
            if not math.isclose(value, own, rel_tol=1e-12)
        )


def swept_name(argument: str, value: float) -> str:
    """What a value's perturbation is called."""
    return f"{argument}={value:g}"


def sweeps_of(data: Mapping[str, Any], nominal: Any) -> tuple[Sweep, ...]:
    """The tables under ``sweep``.

    Raises:
        SpecError: for an argument that the environment lacks, that holds no number, that cells
            vary, or for less than two values.
    """
    ours = is_integ_environment(str(data.get("env_id")))
    found = tuple(_sweep(entry, nominal, ours) for entry in list_of(data, "sweep"))
    check_unique("sweep", [sweep.argument for sweep in found])
    return found


def _sweep(entry: Any, nominal: Any, ours: bool) -> Sweep:
    if not isinstance(entry, Mapping) or set(entry) != {"argument", "values"}:
        if isinstance(entry, Mapping):
            check_keys("key in `sweep`", entry, ("argument", "values"))
        raise SpecError(f"every sweep must be a table with `argument` and `values`, got {entry!r}")
    argument, arguments = text("argument", entry["argument"]), nominal.arguments()
    if argument in DISCRETIZATION:
        raise SpecError(f"`sweep` of `{argument}`, which is what cells vary; use `evaluate` for it")
    if not ours and not _is_number(arguments.get(argument)):
        raise SpecError(
            f"`sweep` of `{argument}`, whose number the environment does not tell; state the value "
            "that it has otherwise under `environment`"
        )
    numbers = [n for n, x in arguments.items() if _is_number(x) or x is None]
    check_known("argument in `sweep`", argument, [n for n in numbers if n not in DISCRETIZATION])
    values = list_of(entry, "values")
    if len(values) < 2 or not all(map(_is_number, values)):
        raise SpecError(f"`values` of the sweep of `{argument}` must be two numbers or more")
    check_unique(f"values of the sweep of {argument}", values)
    unit = nominal.units().get(argument, "")
    return Sweep(argument, tuple(sorted(float(value) for value in values)), unit)


def _is_number(value: Any) -> bool:
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return is_number and math.isfinite(value)
