"""The discretization: what turns a plant into the discrete map that a policy meets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..engines.native import NativeEngine

NATIVE = NativeEngine.name
"""Name of integ-gym's own engine."""


@dataclass(frozen=True, eq=False)
class Discretization:
    """Engine, integrator, dt (s) and control period (s).

    Two are equal where names are equal and times agree as messages write them, to twelve
    significant digits: a step from a file and the same step from a division are one.
    """

    integrator: str
    dt: float
    control_period: float
    engine: str = NATIVE

    @classmethod
    def of(cls, setup: Any) -> Discretization:
        """That of an environment's setup."""
        settings = setup.settings
        period = setup.timing.control_period
        return cls(settings.integrator, settings.dt, period, settings.engine)

    @property
    def name(self) -> str:
        """Short name, without the control period."""
        engine = "" if self.engine == NATIVE else f"{self.engine} "
        return f"{engine}{self.integrator} dt={self.dt:g}"

    @property
    def shares(self) -> dict[Discretization, float]:
        """Share of each discretization that training draws from: this one alone."""
        return {self: 1.0}

    def arguments(self) -> dict[str, Any]:
        """As constructor arguments of an environment, which is its JSON form."""
        return {name: getattr(self, name) for name in DISCRETIZATION}

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Discretization):
            return NotImplemented
        return _written(self.arguments()) == _written(other.arguments())

    def __hash__(self) -> int:
        return hash(tuple(_written(self.arguments()).values()))


DISCRETIZATION = ("engine", "integrator", "dt", "control_period")
"""Names of a discretization's parts, as constructor arguments and in JSON."""


def agrees(stated: Mapping[str, Any], full: Mapping[str, Any]) -> bool:
    """Whether a discretization has all the parts that are stated, by the rule of its equality."""
    return _written(stated) == _written({name: full[name] for name in stated})


def _written(parts: Mapping[str, Any]) -> dict[str, str]:
    return {k: x if isinstance(x, str) else f"{x:.12g}" for k, x in parts.items()}
