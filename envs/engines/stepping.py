"""Engines: a plant advanced over one control period, step by step, with the ledger of energy."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Mapping
from math import isfinite
from types import MappingProxyType
from typing import Any, ClassVar, Protocol, Self

from integ_gym.support.errors import InputError, InputTypeError
from integ_gym.support.optional import check_versions, not_installed, running_version
from integ_gym.support.parameters import unknown_name

from ..integrators.interface import Step
from ..integrators.newton import LEAST_TOLERANCE, Solved
from ..ops.ops import FLOAT32_MAX, SCALAR, Component, Components, Ops, along, select
from ..plants.system import Motion, PlantSystem
from ..registries import ENGINES, INTEGRATORS, TRUTH

DIVERGENCE_SPEED = 1e3
"""A velocity component beyond this magnitude (rad/s or m/s) is a divergence."""


Held = tuple[tuple[Components, int], ...]
"""(controls, number of sub-steps), in their order."""

Segments = tuple[tuple[Components | Callable[[Component], Components], int], ...]
"""(controls, or function of the sub-step from 0 to them; number of sub-steps), in their order."""


class Engine(Protocol):
    """Advances a plant; knows nothing of tasks.

    Built from the system, the integrator's name and the sub-step ``dt`` in seconds.
    """

    batched: ClassVar[bool]
    """Whether components may be of any kind, JAX's traced ones included."""
    width: int
    """Bits of the floats that it computes with outside JAX."""
    reports: bool
    """Whether it reports its solver's iterations, convergence and, if there is one, residual."""
    version: str

    def advance(
        self,
        ops: Ops,
        q: Components,
        v: Components,
        segments: Segments,
        sample_at: Component | None,
    ) -> Motion:
        """Advance through the segments; note the state after sub-step ``sample_at`` (from 1)."""

    def at(self, system: PlantSystem, dt: Component) -> Engine:
        """The same engine for other values of the plant's parameters and the step; if batched."""

    def solver(self) -> dict[str, Any]:
        """`solver_tolerance` and `solver_cap`; None where there is none."""

    def describe(self) -> dict[str, Any]:
        """What the engine is, beyond its name, version and integrator, as plain data."""


def missing_modules(engine: str) -> list[str]:
    """Modules that an engine needs and that are not installed.

    Its extra brings them; of an engine that runs in an environment of its own, what sets that up.
    """
    from integ_gym.support.isolated import ISOLATED

    if engine in ISOLATED:
        return [] if ISOLATED[engine].installed else [engine]
    return not_installed(getattr(ENGINES.load(engine), "modules", ()))


def is_engine(name: str) -> bool:
    """Whether a name is of an engine of ours or a user's; a testbed's own is its package."""
    return ":" in name or name in ENGINES


def engine_versions(engines: Iterable[str]) -> dict[str, str]:
    """Distribution and version behind each engine, this package itself left out."""
    packages = {ENGINES.load(n).package if is_engine(n) else n for n in engines} - {"integ-gym"}
    return {package: running_version(package) for package in sorted(packages)}


def absent_engines() -> tuple[str, ...]:
    """Names of the engines whose extra is not installed."""
    return tuple(name for name in ENGINES.names() if missing_modules(name))


def installed_engines() -> tuple[str, ...]:
    """Names of the installed engines, the native one among them."""
    return tuple(name for name in ENGINES.names() if not missing_modules(name))


def map_of(engine: str, integrator: str) -> str:
    """The one-step map that an engine applies by the name of its integrator."""
    return str(ENGINES.load(engine).maps.get(integrator, integrator))


def make_engine(
    name: str, system: Any, integrator: str, dt: Any, solver: Mapping[str, Any] | None = None
) -> Engine:
    """An engine for a system.

    Args:
        name: of the engine, or ``"module:Class"``.
        system: a `PlantSystem`.
        integrator: as the engine calls it.
        dt: integration step, s.
        solver: settings of the engine's solver that are not its defaults.

    Raises:
        ValueError: for an unknown engine, integrator or setting, or a package of the engine that is
            older than its extra asks for; see `check_versions`.
    """
    kind = ENGINES.load(name)
    check_versions(name)
    engine: Engine = (
        kind(system, integrator, dt, solver) if solver else kind(system, integrator, dt)
    )
    return engine


def solver_with(
    engine: str,
    defaults: Mapping[str, Any],
    given: Mapping[str, Any] | None,
    zeros: Collection[str] = (),
) -> dict[str, Any]:
    """Settings of a solver: the defaults, and those that were given in their place.

    Args:
        engine: its name.
        defaults: all settings, with their values.
        given: in their place.
        zeros: names of those that may be 0.

    Raises:
        ValueError: for a setting that is not among the defaults, and for a value that is no finite
            number above 0, or no whole one where the default is whole.
    """
    given = given or {}
    check_settings(engine, given, defaults)
    return dict(defaults) | {
        name: check_number(name, value, type(defaults[name]), name in zeros)
        for name, value in given.items()
    }


def check_number(name: str, value: Any, kind: type, may_be_zero: bool) -> Any:
    """A setting of a solver that is a number, whole where ``kind`` is `int`.

    Raises:
        ValueError: for another value.
    """
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    positive = number and isfinite(value) and (value > 0 or (may_be_zero and value == 0))
    if not positive or kind(value) != value:
        whole = "a whole number" if kind is int else "a number"
        least = "of at least 0" if may_be_zero else "above 0"
        raise InputError(f"`solver.{name}` must be {whole} {least}, got {value!r}")
    return kind(value)


def check_settings(engine: str, given: Iterable[str], known: Iterable[str]) -> None:
    """Refuse settings of a solver that an engine does not take with an integrator.

    Args:
        engine: its name.
        given: names of settings.
        known: names of those that it takes.

    Raises:
        ValueError: naming the first other one.
    """
    known = tuple(known)
    for name in given:
        if name not in known:
            raise InputError(
                unknown_name(f"setting of `solver` of engine {engine!r}", name, known)
                if known
                else f"engine {engine!r} has no settings of a solver with this integrator; leave "
                "`solver` out"
            )


def has_solver(engine: str, integrator: str) -> bool:
    """Whether an integrator has settings of a solver; of an unknown engine's that is not denied."""
    known = engine in ENGINES.names()
    return not known or bool(ENGINES.load(engine).solves(integrator))


def without_idle_solver(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Constructor arguments of an environment, without `solver` where its integrator has none."""
    idle = arguments.get("solver") and not has_solver(arguments["engine"], arguments["integrator"])
    return {**arguments, "solver": None} if idle else dict(arguments)


def integrators_of(engine: str) -> tuple[str, ...]:
    """The integrators of an engine, as it calls them; ours without the exact one."""
    return tuple(ENGINES.load(engine).maps)


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
    width: int = 64
    """Bits of the floats that it computes with outside JAX."""
    own_stops: ClassVar[bool] = False
    """Whether it has joint stops of its own, for ``contact="engine"``."""
    holds_resistance: ClassVar[bool] = False
    """Whether our stops and friction are forces taken at a step's start and held during it."""
    reports: bool = False
    """Whether it reports its solver's iterations, convergence and, if there is one, residual."""
    solver_tolerance: float | None = None
    """Of a solver, if it has one."""
    solver_cap: int | None = None
    """Most iterations of a solver, if it has one."""
    settings: Mapping[str, Any] = MappingProxyType({})
    """Of its solver, as they are in the simulator, in its own names; empty without a solver."""

    @classmethod
    def solves(cls, integrator: str) -> bool:
        """Whether an integrator has a solver, whose settings can be given."""
        return False

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

        Of engines that are :attr:`~integ_gym.envs.engines.stepping.Engine.batched`.
        """
        other = copy.copy(self)
        other.system, other.dt = system, dt
        return other

    @abstractmethod
    def move(
        self, ops: Ops, q: Components, v: Components, losses: Components, control: Components
    ) -> Step:
        """Advance (q, v, losses) by one step under a constant control."""

    def acceleration(self, q: Components, v: Components, force: Components) -> Components | None:
        """Accelerations at a state under a generalized force, before any step, m/s² or rad/s².

        None: the engine gives a step alone.
        """
        return None

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
            **({"solver": dict(self.settings)} if self.settings else {}),
            "width": self.width,
            "constraint_violation": CONSTRAINT_VIOLATION,
            "resistance": acts if self.system.resisted else None,
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
        system = self.system
        motion = system.begin(q, v)
        done = 0
        for control, count in segments:
            motion = ops.repeat(count, self._booked_step(ops, control, sample_at, done), motion)
            done += count
        motion = system.book_carried(motion)
        if system.servo is not None:
            targets = control(count - 1) if callable(control) else control
            efforts = system.servo.efforts(ops, motion.q, motion.v, targets)
            motion = motion._replace(efforts=efforts)
        if sample_at is None:
            return motion._replace(sampled_q=motion.q, sampled_v=motion.v)
        return motion

    def _booked_step(self, ops: Ops, asked: Any, sample_at: Component | None, done: int):  # type: ignore[no-untyped-def]
        system, move = self.system, self.move
        stops = system.stops or system.engine_stops

        def advance(index: Component, motion: Motion) -> Motion:
            control = asked(index) if callable(asked) else asked
            efforts, squares = motion.efforts, motion.squares
            if system.sampler is not None:
                control = system.sample_servo(ops, motion, control, (done + index, self.dt))
                efforts = control
                squares = along(squares, self.dt, tuple([u * u for u in control]))
            (
                q0, v0, sampled_q, sampled_v, work, losses, clipped, most, worst, converged, ok,
                depth, push, depths, *_,
            ) = motion  # fmt: skip
            q, raw, losses, iterations, residual, solved, bump = move(ops, q0, v0, losses, control)
            v = raw
            if system.speed_limits is not None:
                v = system.limit(ops, raw)
                clipped = clipped + (system.energy(ops, q, raw) - system.energy(ops, q, v))
            if stops is not None:
                contact = stops.contact(ops, q, v)
                bump = contact.force if system.engine_stops is None else bump
                depth = ops.maximum(depth, contact.penetration)
                push = ops.where(abs(bump) > abs(push), bump, push)
            if system.contacts:
                touches = [reaction.touch for reaction in system.reactions(ops, q, v)]
                pairs = zip(depths, touches, strict=True)
                depths = tuple([ops.maximum(deep, touch.penetration) for deep, touch in pairs])
                for touch in touches:
                    depth = ops.maximum(depth, touch.penetration)
                    push = ops.where(touch.normal_force > abs(push), touch.normal_force, push)
            if sample_at is not None:
                now = sample_at == done + index + 1
                sampled_q = select(ops, now, q, sampled_q)
                sampled_v = select(ops, now, v, sampled_v)
            return Motion(
                q,
                v,
                sampled_q,
                sampled_v,
                work + system.work(control, q0, q),
                losses,
                clipped,
                ops.maximum(most, iterations),
                ops.maximum(worst, residual),
                converged & solved,
                ok & within_bounds(q, raw) & (residual <= FLOAT32_MAX),
                depth,
                push,
                depths,
                efforts,
                squares,
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


class NativeEngine(SteppedEngine):
    """Applies one of the integrators to the plant's equations of motion.

    Args:
        system: plant with its stops, friction and speed limit.
        integrator: a registered name or ``"module:Class"``.
        dt: integration step, s.
        solver: ``tolerance`` and ``iterations`` of Newton's method, of our implicit integrators.

    Raises:
        ValueError: for an unknown integrator, or settings of a solver that it has not.
    """

    name: ClassVar[str] = "native"
    package: ClassVar[str] = "integ-gym"
    maps: ClassVar[Mapping[str, str]] = {n: n for n in INTEGRATORS.parts if n != TRUTH}
    batched: ClassVar[bool] = True
    reports: bool = True

    @classmethod
    def solves(cls, integrator: str) -> bool:
        """Whether it is one that solves equations by Newton's method."""
        return issubclass(INTEGRATORS.load(integrator), Solved)

    def __init__(
        self,
        system: PlantSystem,
        integrator: str,
        dt: Component,
        solver: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(system, dt)
        self.integrator = made = INTEGRATORS.load(integrator)()
        defaults = {}
        if isinstance(made, Solved):
            defaults = {"tolerance": made.solver_tolerance, "iterations": made.solver_cap}
        self.settings = solver_with(self.name, defaults, solver)
        if self.settings and self.settings["tolerance"] < LEAST_TOLERANCE:
            raise InputError(
                f"`solver.tolerance` must be at least {LEAST_TOLERANCE:.2g}, for rounding leaves "
                f"no smaller residual, got {self.settings['tolerance']}"
            )
        if self.settings:
            made.solver_tolerance, made.solver_cap = self.settings.values()
        self.solver_tolerance = getattr(self.integrator, "solver_tolerance", None)
        self.solver_cap = getattr(self.integrator, "solver_cap", None)

    def acceleration(self, q: Components, v: Components, force: Components) -> Components:
        """The plant's, with its stops and friction."""
        total = self.system.with_resistance(SCALAR, q, v, force)
        return self.system.plant.acceleration(SCALAR, q, v, total)

    def move(
        self, ops: Ops, q: Components, v: Components, losses: Components, control: Components
    ) -> Step:
        """One step of the integrator."""
        step: Step = self.integrator.step(ops, self.system, q, v, losses, control, self.dt)
        if not isinstance(step, tuple) or len(step) != len(Step._fields):
            raise InputTypeError(
                f"{type(self.integrator).__name__}.step must return an integ_gym.Step, got "
                f"{step!r:.60}; docs/how-to/adding.md has an example"
            )
        return step
