"""One control period in integration steps, with the ledger of energy."""

from __future__ import annotations

import copy
import os
import sys
import tempfile
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, redirect_stderr, redirect_stdout
from functools import cache
from math import hypot, nan
from typing import Any, ClassVar, Self

import numpy as np

from integ_gym.support.errors import InputError
from integ_gym.support.optional import load, running_version
from integ_gym.support.parameters import suggestion

from ..integrators.interface import Step
from ..mechanics import PlantSystem
from ..ops.ops import (
    FLOAT32_MAX,
    Component,
    Components,
    Ops,
)
from ..registries import ENGINES
from .interface import DIVERGENCE_SPEED, Motion, Segments

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
            raise InputError(
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
            raise InputError(
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


def lacks_integrator(engine: str, integrator: str, maps: Mapping[str, str]) -> InputError:
    """The error for an integrator that is none of an engine's, or that has another name there."""
    alike = [name for name, applied in maps.items() if applied == integrator]
    remedy = (
        f"what applies it is {' or '.join(map(repr, alike))}. Valid choices: {', '.join(maps)}"
        if alike
        else f"give `integrator`. {suggestion(integrator, maps)}"
    )
    return InputError(f"engine {engine!r} has no integrator {integrator!r}; {remedy}")


def refuse_arrays(engine: str, system: PlantSystem) -> None:
    """Check that the plant's parameters are numbers.

    Raises:
        ValueError: for one given as an array.
    """
    for name, value in vars(system.plant).items():
        if isinstance(value, np.ndarray):
            raise InputError(
                f"engine {engine!r} takes one value of `{name}` for all environments, got an "
                "array; give a number, or use engine 'native'"
            )


Run = Callable[..., tuple[Any, ...]]
"""(*q, *v, *force) to (*q, *v), and (iterations, residual, converged) of an engine that reports."""

CALM_SPEED = DIVERGENCE_SPEED / 20.0
"""Steps are taken by the stride only where no velocity is beyond this before and after them."""

ASTRAY = 1e9
"""An engine is not asked to go on from values whose norm is beyond this, or not finite."""


class ForeignEngine(MappedEngine):
    """Advances a plant by an engine that is called with floats; lanes one by one."""

    guarded_strides: ClassVar[bool] = False
    """Whether runs of several steps, too, are kept from values that are astray."""

    def __init__(self, system: PlantSystem, integrator: str, dt: float) -> None:
        super().__init__(system, integrator, dt)
        self._run = cache(self._safe_run)

    @abstractmethod
    def run(self, count: int) -> Run:
        """A function that takes ``count`` steps under a constant generalized force."""

    @property
    @abstractmethod
    def straight(self) -> bool:
        """Whether the steps of one control may be taken by one :meth:`stride`."""

    def advance(
        self,
        ops: Ops,
        q: Components,
        v: Components,
        segments: Segments,
        sample_at: Component | None,
    ) -> Motion:
        """Advance through the segments of constant control, in one call each where possible.

        A motion that is fast at either end of a call is done again step by step, so that a step at
        which it diverges is seen.
        """
        if self.straight and sample_at is None:
            motion, hurried = self._in_strides(ops, q, v, segments)
            if ops.usually(ops.any(hurried) == False):  # noqa: E712
                return motion
        return super().advance(ops, q, v, segments, sample_at)

    def _in_strides(
        self, ops: Ops, q: Components, v: Components, segments: Segments
    ) -> tuple[Motion, Component]:
        """One call for each segment; and whether the motion was fast at an end of one."""
        calm = within_bounds(q, v, CALM_SPEED)
        actuated, work = self.system.plant.actuated, 0.0
        losses, most, worst, converged = self.system.no_losses, 0, 0.0, True
        for control, count in segments:
            before = q[actuated]
            force = self.system.generalized(control)
            q, v, losses, iterations, residual, solved, _ = self.stride(
                ops, q, v, losses, force, count
            )
            work = work + control * (q[actuated] - before)
            most, worst = ops.maximum(most, iterations), ops.maximum(worst, residual)
            converged = converged & solved
            calm = calm & within_bounds(q, v, CALM_SPEED)
        motion = Motion(q, v, q, v, work, losses, 0.0, most, worst, converged, calm)
        return motion, calm == False  # noqa: E712

    def stride(
        self,
        ops: Ops,
        q: Components,
        v: Components,
        losses: Components,
        force: Components,
        count: int,
    ) -> Step:
        """Take ``count`` steps in one call, without a loss."""
        q, v, *report = self.travel(ops, q, v, force, count)
        return Step(q, v, losses, *report)

    def travel(
        self, ops: Ops, q: Components, v: Components, force: Components, count: int
    ) -> tuple[Components, Components, Component, Component, Component]:
        """Take ``count`` steps; q, v, and the solver's iterations, residual and convergence."""
        n = len(q)
        flat, report = self._called_with(ops, self._run(count), (*q, *v, *force), 2 * n)
        return flat[:n], flat[n:], *report

    def _called_with(
        self, ops: Ops, run: Run, values: Components, numbers: int
    ) -> tuple[Components, Components]:
        """What a run gives: so many numbers, and the solver's report or that nothing went wrong."""
        truths = (*[False] * numbers, *((False, False, True) if self.reports else ()))
        flat = ops.foreign(run, values, truths)
        return flat[:numbers], flat[numbers:] or (0, 0.0, True)

    def _safe_run(self, count: int) -> Run:
        made = self.run(count)
        if count > 1 and not self.guarded_strides:
            return made
        report = (0, 0.0, False) if self.reports else ()
        return guarded(made, (*(nan,) * (2 * len(self.system.plant.coordinates)), *report))


def guarded(run: Run, lost: tuple[Any, ...]) -> Run:
    """``run``, but ``lost`` from arguments that are astray."""

    def safe(*values: float) -> tuple[Any, ...]:
        return run(*values) if hypot(*values) < ASTRAY else lost

    return safe


def is_astray(values: Sequence[float]) -> bool:
    """Whether the values' norm is beyond :data:`ASTRAY`, or not finite."""
    return not hypot(*values) < ASTRAY


def load_undisturbed(module: str, extra: str, banner: str | None = None) -> Any:
    """Import a module as :func:`load` does; its first import leaves no trace but the module.

    Environment variables stay as they were, warnings of the import are not shown, and lines of
    standard error that begin with ``banner`` are left out.

    Raises:
        ModuleNotFoundError: if its package is not installed.
    """
    if module in sys.modules:
        return load(module, extra)
    heard = nullcontext() if banner is None else _standard_error_without(banner.encode())
    with _same_environment(), warnings.catch_warnings(), heard:
        warnings.simplefilter("ignore")
        return load(module, extra)


@contextmanager
def quiet() -> Iterator[None]:
    """Leave out what is written to stdout and stderr meanwhile, by compiled code too; and warnings.

    Of the whole process: what another thread writes at that time is lost as well.
    """
    with (
        open(os.devnull, "w", encoding="utf-8") as nothing,
        _written_to(nothing.fileno(), 1, 2),
        redirect_stdout(nothing),
        redirect_stderr(nothing),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore")
        yield


@contextmanager
def _same_environment() -> Iterator[None]:
    before = dict(os.environ)
    try:
        yield
    finally:
        for name in os.environ.keys() - before.keys():
            del os.environ[name]
        os.environ.update(before)


@contextmanager
def _standard_error_without(banner: bytes) -> Iterator[None]:
    """Hold back what is written to file descriptor 2; then pass on all lines but the banner."""
    with tempfile.TemporaryFile() as held:
        try:
            with _written_to(held.fileno(), 2):
                yield
        finally:
            held.seek(0)
            for line in held:
                if not line.startswith(banner):
                    os.write(2, line)


@contextmanager
def _written_to(target: int, *streams: int) -> Iterator[None]:
    """Let one file descriptor stand for others of the process."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = [os.dup(stream) for stream in streams]
    try:
        for stream in streams:
            os.dup2(target, stream)
        yield
    finally:
        for stream, copy in zip(streams, kept, strict=True):
            os.dup2(copy, stream)
            os.close(copy)
