"""The control period of every engine: its steps, and what is booked after each."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from typing import Any, ClassVar, Self

from integ_gym.support.packages.versions import running_version

from ...arithmetic.ops import (
    FLOAT32_MAX,
    Component,
    Components,
    Ops,
)
from ...integrators.interface import Step
from ...mechanics.system import PlantSystem
from ...registries import ENGINES
from ..interface import DIVERGENCE_SPEED, Motion, Segments

CONSTRAINT_VIOLATION = "not applicable: generalized coordinates"
"""Of engines whose joints are coordinates: there is no constraint that a step could violate."""


class SteppedEngine(ABC):
    """Advances the plant step by step under a constant control.

    Args:
        system: plant with its stops, friction and speed limit.
        dt: integration step, s.

    Raises:
        ValueError: if the stops are left to an engine that has none, with those that have.
    """

    name: ClassVar[str]
    package: ClassVar[str]
    """Distribution whose version is recorded."""
    width: ClassVar[int] = 64
    """Bits of the floats that it computes with outside JAX."""
    own_stops: ClassVar[bool] = False
    """Whether it has joint stops of its own, for ``contact="engine"``."""
    holds_resistance: ClassVar[bool] = False
    """Whether our stops and friction are forces taken at a step's start and held during it."""
    reports: bool = False
    """Whether it tells its solver's iterations and convergence, and its residual if it has one."""
    solver_tolerance: float | None = None
    """Of a solver, if it has one."""
    solver_cap: int | None = None
    """Most iterations of a solver, if it has one."""

    def __init__(self, system: PlantSystem, dt: Component) -> None:
        if system.engine_stops is not None and not self.own_stops:
            raise ValueError(
                f"engine {self.name!r} has no joint stops of its own; use one that has "
                f"({', '.join(engines_with_stops())}), or `contact`='compliant', the same law in "
                "every engine"
            )
        self.system = system
        self.dt = dt
        self.version = running_version(self.package)

    def at(self, system: PlantSystem, dt: Component) -> Self:
        """The same engine for other values of parameters and step, which are not looked at.

        Of engines that are :attr:`~integ_gym.envs.engines.interface.Engine.batched`.
        """
        other = copy.copy(self)
        other.system, other.dt = system, dt
        return other

    @abstractmethod
    def move(
        self, ops: Ops, q: Components, v: Components, losses: Components, control: Component
    ) -> Step:
        """Advance (q, v, losses) by one step under a constant control."""

    def solver(self) -> dict[str, Any]:
        """`solver_tolerance` and `solver_cap`; None where there is none."""
        return {"solver_tolerance": self.solver_tolerance, "solver_cap": self.solver_cap}

    def describe(self) -> dict[str, Any]:
        """What the engine is, beyond its name, version and integrator, as plain data.

        `resistance` is where the force of our stops and friction acts, None without either.
        """
        held = self.holds_resistance
        acts = "held over the step" if held else "within the integrator's stages"
        return {
            "width": self.width,
            "constraint_violation": CONSTRAINT_VIOLATION,
            "resistance": acts if self.system.steep else None,
        }

    def advance(
        self,
        ops: Ops,
        q: Components,
        v: Components,
        segments: Segments,
        sample_at: Component | None,
    ) -> Motion:
        """Advance through the segments of constant control."""
        motion = Motion(q, v, q, v, 0.0, self.system.no_losses, 0.0, 0, 0.0, True, True)
        done = 0
        for control, count in segments:
            motion = ops.repeat(count, self._booked_step(ops, control, sample_at, done), motion)
            done += count
        if sample_at is None:
            return motion._replace(sampled_q=motion.q, sampled_v=motion.v)
        return motion

    def _booked_step(self, ops: Ops, control: Component, sample_at: Component | None, done: int):  # type: ignore[no-untyped-def]
        system, move = self.system, self.move
        actuated, stops = system.plant.actuated, system.stops or system.engine_stops

        def advance(index: Component, motion: Motion) -> Motion:
            (
                q0, v0, sampled_q, sampled_v, work, losses, clipped, most, worst, converged, ok,
                depth, push,
            ) = motion  # fmt: skip
            q, raw, losses, iterations, residual, solved, bump = move(ops, q0, v0, losses, control)
            v = raw
            if system.max_speed is not None:
                v = system.limit(ops, raw)
                clipped = clipped + (system.energy(ops, q, raw) - system.energy(ops, q, v))
            if stops is not None:
                contact = stops.contact(ops, q, v)
                bump = contact.force if system.engine_stops is None else bump
                depth = ops.maximum(depth, contact.penetration)
                push = ops.where(abs(bump) > abs(push), bump, push)
            if sample_at is not None:
                now = sample_at == done + index + 1
                sampled_q = tuple([ops.where(now, a, b) for a, b in zip(q, sampled_q, strict=True)])
                sampled_v = tuple([ops.where(now, a, b) for a, b in zip(v, sampled_v, strict=True)])
            return Motion(
                q,
                v,
                sampled_q,
                sampled_v,
                work + control * (q[actuated] - q0[actuated]),
                losses,
                clipped,
                ops.maximum(most, iterations),
                ops.maximum(worst, residual),
                converged & solved,
                ok & within_bounds(q, raw),
                depth,
                push,
            )

        return advance


def engines_with_stops() -> tuple[str, ...]:
    """Names of the registered engines that have joint stops of their own."""
    return tuple(
        name for name in ENGINES.names() if getattr(ENGINES.load(name), "own_stops", False)
    )


def within_bounds(q: Components, v: Components, speed: float = DIVERGENCE_SPEED) -> Component:
    """Whether a state is finite, representable in float32 and nowhere faster than ``speed``."""
    ok = abs(v[0]) <= speed
    for x in v[1:]:
        ok = ok & (abs(x) <= speed)
    for x in q:
        ok = ok & (abs(x) <= FLOAT32_MAX)
    return ok
