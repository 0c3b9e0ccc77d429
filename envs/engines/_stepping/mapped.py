"""Engines whose integrators carry names of the engine's own, each a known one-step map."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from integ_gym.support.parameters import suggestion

from ...mechanics.system import PlantSystem
from .stepped import SteppedEngine


class MappedEngine(SteppedEngine):
    """Advances a plant whose parameters are numbers by an integrator of the engine's own.

    Args:
        system: plant with its stops, friction and speed limit.
        integrator: one of the engine's own; see :attr:`maps`.
        dt: integration step, s.

    Raises:
        ValueError: for an integrator that the engine lacks, with those it has, and for plant
            parameters given as arrays.
    """

    batched: ClassVar[bool] = False
    modules: ClassVar[tuple[str, ...]]
    """Modules that it imports from other packages."""
    maps: ClassVar[Mapping[str, str]]
    """Integrator, as the engine calls it, to the one-step map that it applies."""
    stopless: ClassVar[frozenset[str]] = frozenset()
    """Integrators to which the joint stops of an engine that has them do nothing."""

    def __init__(self, system: PlantSystem, integrator: str, dt: float) -> None:
        super().__init__(system, dt)
        if integrator not in self.maps:
            raise lacks_integrator(self.name, integrator, self.maps)
        refuse_arrays(self.name, system)
        if system.engine_stops is not None and integrator in self.stopless:
            others = ", ".join(name for name in self.maps if name not in self.stopless)
            raise ValueError(
                f"integrator {integrator!r} of engine {self.name!r} ignores joint stops; use "
                f"`integrator`: {others}, or `contact`='compliant', the same law in every engine"
            )
        self.integrator = integrator

    @property
    def map(self) -> str:
        """Name of the one-step map that the integrator applies."""
        return self.maps[self.integrator]

    def describe(self) -> dict[str, Any]:
        """What every engine says, the map that is applied, and the engine's own stops."""
        stops = None if self.system.engine_stops is None else self.stop_parameters()
        return {**super().describe(), "map": self.map, "stops": stops}

    def stop_parameters(self) -> dict[str, Any]:
        """Parameters of the engine's own joint stops, in its own names."""
        return {}


def lacks_integrator(engine: str, integrator: str, maps: Mapping[str, str]) -> ValueError:
    """The error for an integrator that is none of an engine's, or that has another name there."""
    alike = [name for name, applied in maps.items() if applied == integrator]
    remedy = (
        f"what applies it is {' or '.join(map(repr, alike))}. Valid choices: {', '.join(maps)}"
        if alike
        else f"give `integrator`. {suggestion(integrator, maps)}"
    )
    return ValueError(f"engine {engine!r} has no integrator {integrator!r}; {remedy}")


def refuse_arrays(engine: str, system: PlantSystem) -> None:
    """Check that the plant's parameters are numbers.

    Raises:
        ValueError: for one given as an array.
    """
    for name, value in vars(system.plant).items():
        if isinstance(value, np.ndarray):
            raise ValueError(
                f"engine {engine!r} takes one value of `{name}` for all environments, got an "
                "array; give a number, or use engine 'native'"
            )
