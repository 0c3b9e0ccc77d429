"""Engines: a plant advanced over one control period, step by step, with the ledger of energy."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Mapping
from functools import reduce
from math import inf, isfinite
from operator import add
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple, Protocol, Self

from integ_gym.support.errors import InputError, InputTypeError
from integ_gym.support.optional import check_versions, not_installed, running_version
from integ_gym.support.parameters import unknown_name

from ..integrators.interface import Step
from ..integrators.newton import LEAST_TOLERANCE, Solved
from ..mechanics import Friction, Kink, Servo
from ..ops.ops import FLOAT32_MAX, SCALAR, Component, Components, Ops, along
from ..plants.contact import ContactPoint, Reaction, Stops
from ..plants.interface import Plant
from ..registries import ENGINES, INTEGRATORS, TRUTH

DIVERGENCE_SPEED = 1e3
"""A velocity component beyond this magnitude (rad/s or m/s) is a divergence."""


class PlantSystem:
    """A plant at a constant control, with its contacts and friction, and an optional speed limit.

    Args:
        plant: the continuous-time plant.
        max_speed: largest magnitude of each velocity component, rad/s or m/s, or None: the plant's
            own limits, where it has some.
        engine_stops: whether the stops are left to the engine.
        servo: where the controls are its targets, else None.

    Attributes:
        speed_limits: largest magnitude of each velocity, or None.
        stops: the plant's stops, or None where there are none of ours.
        engine_stops: the plant's stops where the engine has them act by its own law, else None.
        contacts: the plant's contact points, with the names of its `contact_names`.
        resisted: whether there are stops, contact points or friction.
        steep: whether there are those, or a servo within the field.
        kinked: whether there are stops or contact points.
        servo: that acts within the vector field, or None.
        sampler: the servo that is computed at the start of steps, or None.
        no_losses: zero of every loss component: (damping,), (damping, contact) with stops of either
            kind, or with contact points (damping, contact, friction in contact); then of what is
            carried with them: where controls are more than forces along coordinates their work, J,
            and of a servo within the field the integral of each squared effort.
    """

    def __init__(
        self,
        plant: Plant,
        max_speed: Component | None = None,
        engine_stops: bool = False,
        servo: Servo | None = None,
    ) -> None:
        self.plant = plant
        self.max_speed = max_speed
        own, lagging = getattr(plant, "speed_limits", None), getattr(plant, "lagging", ())
        limits = own if max_speed is None else (max_speed,) * len(plant.velocities)
        self.speed_limits: Components | None = limits and tuple(  # a thrust is no speed
            [inf if x is None or i in lagging else x for i, x in enumerate(limits)]
        )
        stops: Stops | None = getattr(plant, "stops", None)
        self.stops = None if engine_stops else stops
        self.engine_stops = stops if engine_stops else None
        self.contacts: tuple[ContactPoint, ...] = getattr(plant, "contacts", ())
        self.kinked = self.stops is not None or bool(self.contacts)
        kinds = 3 if self.contacts else 1 if stops is None else 2
        self.no_losses: Components = (0.0,) * kinds
        self._friction: Friction | None = getattr(plant, "dry_friction", None)
        continuous = servo is not None and servo.when == "continuous"
        self.servo = servo if continuous else None
        self.sampler = None if continuous else servo
        self.resisted = self.kinked or self._friction is not None
        self.steep = self.resisted or continuous
        self._before = (0.0,) * plant.actuated[0]
        self._after = (0.0,) * (len(plant.coordinates) - plant.actuated[0] - 1)
        self.input_forces = getattr(plant, "input_forces", None)
        self._carried = 0 if self.input_forces is None and self.servo is None else 1
        if self.servo is not None:
            self._carried += len(plant.controls)
        self._unresisted = self.no_losses[1:]
        self.no_losses = (*self.no_losses, *(0.0,) * self._carried)
        self._jacobian = None if self.input_forces else getattr(plant, "jacobian", None)
        self._moving = [i for i in range(len(plant.coordinates)) if i not in lagging]

    def generalized(self, controls: Components) -> Components:
        """Controls as a generalized force, one entry per coordinate, of a plant where they are."""
        if len(controls) == 1:
            return (*self._before, controls[0], *self._after)
        force: list[Component] = [0.0] * len(self.plant.coordinates)
        for place, control in zip(self.plant.actuated, controls, strict=True):
            force[place] = control
        return tuple(force)

    def power(self, ops: Ops, q: Components, v: Components, controls: Components) -> Component:
        """Of the controls, W."""
        return self._power_of(self.forces(ops, q, v, controls), v)

    def _power_of(self, force: Components, v: Components) -> Component:
        return reduce(add, [force[i] * v[i] for i in self._moving])

    def work(self, controls: Components, before: Components, after: Components) -> Component:
        """Of held controls between two configurations, J, by the coordinates that they drive.

        0 where it is carried among the losses.
        """
        if self._carried:
            return 0.0
        pairs = zip(controls, self.plant.actuated, strict=True)
        return reduce(add, [u * (after[k] - before[k]) for u, k in pairs])

    def begin(self, q: Components, v: Components) -> Motion:
        """A motion of no time, with nothing booked."""
        motion = Motion(q, v, q, v, 0.0, self.no_losses, 0.0, 0, 0.0, True, True)
        motion = motion._replace(depths=(0.0,) * len(self.contacts))
        if self.servo is None and self.sampler is None:
            return motion
        none = (0.0 * q[0],) * len(self.plant.controls)
        return motion._replace(efforts=none, squares=none)

    def book_carried(self, motion: Motion) -> Motion:
        """A motion with the work and the squares that it carries among its losses as its own."""
        if not self._carried:
            return motion
        count = len(motion.losses) - self._carried
        work, *squares = motion.losses[count:]
        return motion._replace(losses=motion.losses[:count], work=work, squares=tuple(squares))

    def sample_servo(
        self, ops: Ops, motion: Motion, targets: Components, at: tuple[Component, Component]
    ) -> Components:
        """Efforts in a step: computed at its start, or at that of an earlier one and held.

        Args:
            ops: arithmetic.
            motion: so far in the control period.
            targets: of the servo.
            at: the step, from 0, and its length, s.
        """
        servo, (index, dt) = self.sampler, at
        assert servo is not None
        efforts = servo.efforts(ops, motion.q, motion.v, targets)
        if servo.when == "step":
            return efforts
        due = index % servo.steps(ops, dt) == 0
        return tuple(
            [ops.where(due, new, old) for new, old in zip(efforts, motion.efforts, strict=True)]
        )

    def forces(self, ops: Ops, q: Components, v: Components, controls: Components) -> Components:
        """Generalized force of the controls, one entry per coordinate."""
        if self.servo is not None:
            return self.generalized(self.servo.efforts(ops, q, v, controls))
        if self.input_forces is None:
            return self.generalized(controls)
        force: Components = self.input_forces(ops, q, v, controls)
        return force

    def rates(
        self, ops: Ops, q: Components, v: Components, control: Components
    ) -> tuple[Components, Components]:
        """Accelerations and the power of each loss component, W."""
        plant = self.plant
        if self._carried:
            force = self.forces(ops, q, v, control)
            power = self._power_of(force, v)
            squares = () if self.servo is None else [force[k] * force[k] for k in plant.actuated]
            force, losses = self._resisted(ops, q, v, force)
            return plant.acceleration(ops, q, v, force), (*losses, power, *squares)
        force = self.generalized(control)
        if not self.steep:
            return plant.acceleration(ops, q, v, force), (plant.dissipation(ops, q, v),)
        force, losses = self._resisted(ops, q, v, force)
        return plant.acceleration(ops, q, v, force), losses

    def with_resistance(
        self, ops: Ops, q: Components, v: Components, force: Components
    ) -> Components:
        """A generalized force with that of friction, of our stops and of contact points."""
        return self._resisted(ops, q, v, force)[0] if self.steep else force

    def slopes(
        self, ops: Ops, q: Components, v: Components, control: Components
    ) -> tuple[tuple[Components, ...], tuple[Components, ...]] | None:
        """(∂a/∂q, ∂a/∂v) of the plant with contact and friction, or None if it gives none."""
        if self._jacobian is None:
            return None
        force = self.forces(ops, q, v, control)
        if not self.steep:
            return self._jacobian(ops, q, v, force)  # type: ignore[no-any-return]
        force, _ = self._resisted(ops, q, v, force)
        by_q, by_v = self._jacobian(ops, q, v, force)
        responses = self._responses(ops, q, v)
        if self.stops is not None or self._friction is not None or self.servo is not None:
            for j, (force_by_q, force_by_v) in enumerate(self._force_slopes(ops, q, v, control)):
                by_q = _column_added(by_q, j, responses[j], force_by_q)
                by_v = _column_added(by_v, j, responses[j], force_by_v)
        for contact in self.contacts:
            columns_by_q, columns_by_v = contact.slopes(ops, q, v)
            for j, columns in enumerate(zip(columns_by_q, columns_by_v, strict=True)):
                for response, slope_by_q, slope_by_v in zip(responses, *columns, strict=True):
                    by_q = _column_added(by_q, j, response, slope_by_q)
                    by_v = _column_added(by_v, j, response, slope_by_v)
        return by_q, by_v

    def limit(self, ops: Ops, v: Components) -> Components:
        """``v`` with each component within its limit."""
        if self.speed_limits is None:
            return v
        pairs = zip(v, self.speed_limits, strict=True)
        return tuple([ops.maximum(-most, ops.minimum(x, most)) for x, most in pairs])

    def kinks(self, ops: Ops, q: Components, v: Components, control: Component) -> tuple[Kink, ...]:
        """Where the accelerations have a kink: at the nearer stop, and at contact points."""
        found: tuple[Kink, ...] = ()
        if self.stops is not None:
            found = (Kink(*self.stops.clearance(ops, q, v)),)
        if self.contacts:
            acceleration, _ = self.rates(ops, q, v, control)
            for contact in self.contacts:
                found += contact.kinks(ops, q, v, acceleration)
        return found

    def reactions(self, ops: Ops, q: Components, v: Components) -> tuple[Reaction, ...]:
        """What every contact point meets in the state (q, v)."""
        return tuple([contact.reaction(ops, q, v) for contact in self.contacts])

    def energy(self, ops: Ops, q: Components, v: Components) -> Component:
        """Energy of the plant and of what it touches, J."""
        energy = self.plant.energy(ops, q, v)
        if self.stops is not None:
            energy = energy + self.stops.contact(ops, q, v).energy
        for reaction in self.reactions(ops, q, v):
            energy = energy + reaction.energy
        return energy

    def confined(self, ops: Ops, q: Components) -> Components:
        """``q`` between the stops, ours or the engine's."""
        stops = self.engine_stops if self.stops is None else self.stops
        return q if stops is None else stops.confined(ops, q)

    def resistance(self, ops: Ops, q: Components, v: Components) -> tuple[Components, Components]:
        """Generalized forces of friction and contact, and the power of each loss component by them.

        The plant's own damping is not among them.
        """
        force: Components = (0.0,) * len(v)
        rubbed: Component = 0.0
        if self._friction is not None:
            force = self._friction.forces(ops, v)
            for x, f in zip(v, force, strict=True):
                rubbed = rubbed - f * x
        losses = (rubbed, *self._unresisted)
        if self.stops is not None:
            contact = self.stops.contact(ops, q, v)
            i = self.stops.coordinate
            force = (*force[:i], force[i] + contact.force, *force[i + 1 :])
            losses = (rubbed, contact.dissipated, *losses[2:])
        for reaction in self.reactions(ops, q, v):
            force = tuple([a + b for a, b in zip(force, reaction.force, strict=True)])
            losses = (rubbed, losses[1] + reaction.damped, losses[2] + reaction.rubbed)
        return force, losses

    def _resisted(
        self, ops: Ops, q: Components, v: Components, force: Components
    ) -> tuple[Components, Components]:
        """Force with friction and contact, and the power of each loss component."""
        resisting, losses = self.resistance(ops, q, v)
        total = tuple([a + b for a, b in zip(force, resisting, strict=True)])
        return total, (self.plant.dissipation(ops, q, v) + losses[0], *losses[1:])

    def _force_slopes(
        self, ops: Ops, q: Components, v: Components, controls: Components
    ) -> list[Components]:
        """(∂F_j/∂q_j, ∂F_j/∂v_j) of friction, contact and servo, for each coordinate j."""
        by_v = (0.0,) * len(v) if self._friction is None else self._friction.slopes(ops, v)
        slopes: list[Components] = [(0.0, slope) for slope in by_v]
        if self.stops is not None:
            i = self.stops.coordinate
            contact_by_q, contact_by_v = self.stops.slopes(ops, q, v)
            slopes[i] = (contact_by_q, slopes[i][1] + contact_by_v)
        if self.servo is not None:
            for j, by_q, by_speed in self.servo.slopes(ops, q, v, controls):
                slopes[j] = (slopes[j][0] + by_q, slopes[j][1] + by_speed)
        return slopes

    def _responses(self, ops: Ops, q: Components, v: Components) -> list[Components]:
        """Accelerations per unit of force on each coordinate: they are affine in the force."""
        none = (0.0,) * len(v)
        free = self.plant.acceleration(ops, q, v, none)
        units = [(*none[:j], 1.0, *none[j + 1 :]) for j in range(len(v))]
        pushed = [self.plant.acceleration(ops, q, v, unit) for unit in units]
        return [tuple([a - b for a, b in zip(each, free, strict=True)]) for each in pushed]


def _column_added(
    matrix: tuple[Components, ...], j: int, response: Components, slope: Component
) -> tuple[Components, ...]:
    """``matrix`` with ``response`` times ``slope`` added to its column ``j``."""
    return tuple(
        (*row[:j], row[j] + a * slope, *row[j + 1 :])
        for row, a in zip(matrix, response, strict=True)
    )


class Motion(NamedTuple):
    """A plant's motion over one control period."""

    q: Components
    v: Components
    sampled_q: Components
    """Configuration at the sensor's last sample in this period, if there was one."""
    sampled_v: Components
    work: Component
    """Of the controls, J: Σ over sub-steps of each times the displacement of its coordinate."""
    losses: Components
    """Energy lost per loss component, J; see :attr:`PlantSystem.no_losses`."""
    clip_loss: Component
    """Energy taken out by the speed limit, J."""
    iterations: Component
    """Most solver iterations of any sub-step."""
    residual: Component
    """Largest scaled solver residual of any sub-step."""
    converged: Component
    finite: Component
    """False once a sub-step has diverged."""
    penetration: Component = 0.0
    """Deepest at the end of any sub-step, m or rad."""
    contact_force: Component = 0.0
    """Of largest magnitude at the end of any sub-step, N or N m."""
    depths: Components = ()
    """Deepest penetration of each contact point at the end of any sub-step, m."""
    efforts: Components = ()
    """Of a servo, in force at the end, N or N m."""
    squares: Components = ()
    """Of a servo, the integral of each squared effort, N² s or N² m² s."""


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
    """Whether it tells its solver's iterations and convergence, and its residual if it has one."""
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
        name: checked_number(name, value, type(defaults[name]), name in zeros)
        for name, value in given.items()
    }


def checked_number(name: str, value: Any, kind: type, may_be_zero: bool) -> Any:
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
    """Whether it tells its solver's iterations and convergence, and its residual if it has one."""
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
                sampled_q = tuple([ops.where(now, a, b) for a, b in zip(q, sampled_q, strict=True)])
                sampled_v = tuple([ops.where(now, a, b) for a, b in zip(v, sampled_v, strict=True)])
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
                ok & within_bounds(q, raw),
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
