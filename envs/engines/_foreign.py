"""Engines whose steps are not made of our own arithmetic: one call of floats for each."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np

from integ_gym.envs.engines._stepped import SteppedEngine, within_bounds
from integ_gym.envs.engines.interface import Motion, Segments
from integ_gym.envs.ops import Component, Components, Ops
from integ_gym.envs.parameters import unknown_name
from integ_gym.envs.system import PlantSystem
from integ_gym.envs.versions import package_version

Run = Callable[..., tuple[float, ...]]
"""(*q, *v, *force) to (*q, *v), and (iterations, residual, converged) of an engine that reports."""

ASTRAY = 1e9
"""An engine is not asked to go on from a state with a component beyond this, or not finite."""


class ForeignEngine(SteppedEngine):
    """Advances a plant whose parameters are numbers; lanes of a vector environment one by one.

    Args:
        system: plant with its stops, friction and speed limit.
        integrator: one of the engine's own; see :attr:`maps`.
        dt: integration step, s.

    Raises:
        ValueError: for an integrator that the engine lacks, with those it has, and for plant
            parameters given as arrays.
    """

    batched: ClassVar[bool] = False
    package: ClassVar[str]
    """Distribution whose version is recorded."""
    maps: ClassVar[Mapping[str, str]]
    """Integrator, as the engine calls it, to the one-step map that it applies."""
    reports: ClassVar[bool] = False
    """Whether it tells its solver's iterations, residual and convergence."""

    def __init__(self, system: PlantSystem, integrator: str, dt: float) -> None:
        super().__init__(system, dt)
        if integrator not in self.maps:
            raise ValueError(
                unknown_name(f"integrator of engine {self.name!r}", integrator, self.maps)
            )
        refuse_arrays(self.name, system)
        self.integrator = integrator
        self.version = package_version(self.package) or "unknown"
        self._runs: dict[int, Run] = {}

    @property
    def map(self) -> str:
        """Name of the one-step map that the integrator applies."""
        return self.maps[self.integrator]

    def describe(self) -> dict[str, Any]:
        """Float width, the map that is applied, and the parameters of the engine's own stops."""
        stops = None if self.system.engine_stops is None else self.stop_parameters()
        return {**super().describe(), "map": self.map, "stops": stops}

    def stop_parameters(self) -> dict[str, Any]:
        """Parameters of the engine's own joint stops, in its own names."""
        return {}

    @abstractmethod
    def run(self, count: int) -> Run:
        """A function that takes ``count`` steps under a constant generalized force."""

    @property
    @abstractmethod
    def straight(self) -> bool:
        """Whether nothing but the work is booked between the steps of one control."""

    def advance(
        self,
        ops: Ops,
        q: Components,
        v: Components,
        segments: Segments,
        sample_at: Component | None,
    ) -> Motion:
        """Advance through the segments of constant control, in one call each where possible."""
        if not self.straight or sample_at is not None:
            return super().advance(ops, q, v, segments, sample_at)
        actuated, work = self.system.plant.actuated, 0.0
        most, worst, converged = 0, 0.0, True
        for control, count in segments:
            before = q[actuated]
            force = self.system.generalized(control)
            q, v, iterations, residual, solved = self.travel(ops, q, v, force, count)
            work = work + control * (q[actuated] - before)
            most, worst = ops.maximum(most, iterations), ops.maximum(worst, residual)
            converged = converged & solved
        ok, losses = within_bounds(q, v), self.system.no_losses
        return Motion(q, v, q, v, work, losses, 0.0, most, worst, converged, ok)

    def travel(
        self, ops: Ops, q: Components, v: Components, force: Components, count: int
    ) -> tuple[Components, Components, Component, Component, Component]:
        """Take ``count`` steps; q, v, and the solver's iterations, residual and convergence."""
        run = self._run(count)
        n = len(q)
        truths = (*[False] * (2 * n), *((False, False, True) if self.reports else ()))
        flat = ops.foreign(run, (*q, *v, *force), truths)
        report = flat[2 * n :] if self.reports else (0, 0.0, True)
        return flat[:n], flat[n : 2 * n], *report

    def _run(self, count: int) -> Run:
        if count not in self._runs:
            made = self.run(count)
            self._runs[count] = made if self.straight else self._guarded(made)
        return self._runs[count]

    def _guarded(self, run: Run) -> Run:
        """``run``, but NaN from a state that is astray."""
        lost = (np.nan,) * (2 * len(self.system.plant.coordinates))
        lost_with_report = (*lost, 0, 0.0, False) if self.reports else lost

        def guarded(*values: float) -> tuple[float, ...]:
            for x in values:
                if not -ASTRAY < x < ASTRAY:
                    return lost_with_report
            return run(*values)

        return guarded


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
