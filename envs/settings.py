"""What an environment's arguments stand for: discretization, timing, setup, mixtures of them."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from itertools import accumulate
from typing import Any

import numpy as np
from gymnasium import spaces

from integ_gym.support.errors import InputError, InputTypeError
from integ_gym.support.parameters import (
    check_values,
    nonnegative,
    one_of,
    optional,
    parameter,
    plain_table,
    positive,
    probability,
    suggestion,
    text,
    units,
    unknown_name,
)

from .actuators import SERVO_ARGUMENTS, ServoPlant, with_efforts, with_servo, with_targets
from .engines.stepping import DIVERGENCE_SPEED, Engine, NativeEngine, make_engine
from .mechanics import Servo
from .ops.ops import SCALAR, Component
from .plants.interface import Plant
from .plants.system import PlantSystem
from .tasks.interface import Task

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
    def scheme(self) -> Discretization:
        """The same at a step of 1 s, which is equal for all steps of one scheme."""
        return replace(self, dt=1.0)

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
        return _format_parts(self.arguments()) == _format_parts(other.arguments())

    def __hash__(self) -> int:
        return hash(tuple(_format_parts(self.arguments()).values()))


def unlike_names(places: Sequence[Discretization]) -> list[str]:
    """Names of discretizations, with the control period where another has the same name."""
    alike = ({one for one in places if one.name == place.name} for place in places)
    pairs = zip(places, alike, strict=True)
    return [p.name + f" control={p.control_period:g}" * (len(same) > 1) for p, same in pairs]


STEPPING = ("engine", "integrator", "dt")
"""Names of what advances a plant, as constructor arguments and in JSON."""

DISCRETIZATION = (*STEPPING, "control_period")
"""Names of a discretization's parts, likewise."""


def agrees(stated: Mapping[str, Any], full: Mapping[str, Any]) -> bool:
    """Whether a discretization has all the parts that are stated, by the rule of its equality."""
    return _format_parts(stated) == _format_parts({name: full[name] for name in stated})


def _format_parts(parts: Mapping[str, Any]) -> dict[str, str]:
    return {k: x if isinstance(x, str) else f"{x:.12g}" for k, x in parts.items()}


FIXED_DELAYS = ("action_latency", "observation_latency")
"""Constructor arguments of every environment, own or foreign, s: how late all commands and all
observations are."""

LATENCIES = (*FIXED_DELAYS, "latency_jitter")
"""Constructor arguments that are whole multiples of ``dt``, 0 included."""

DRAWN = ("latency_jitter", "hold_probability")
"""Constructor arguments for which something is drawn at every decision, if they are not 0."""

DELAYS = (*FIXED_DELAYS, *DRAWN)
"""Constructor arguments by which commands or observations are late."""


def delays_in(arguments: Mapping[str, Any]) -> dict[str, float]:
    """The delays among arguments; 0 where they are left out."""
    return {name: float(arguments.get(name) or 0.0) for name in DELAYS}


TOLERANCE = 1e-9
"""Relative tolerance of a whole multiple."""

MOST = 1e9
"""No time is a larger multiple of another."""

NO_LIMIT = 10**8
"""Decisions of an episode without a limit, at least."""

FINEST_DIVISION = 1000
"""Parts of the reference's step that are tried to fit latencies and sensor periods."""


def is_multiple(value: float, unit: float) -> bool:
    """Whether ``value`` is a whole multiple of ``unit``, 0 included, within the tolerance."""
    ratio = value / unit
    return abs(ratio - round(ratio)) <= TOLERANCE * max(1, round(ratio))


def dividing_step(arguments: Mapping[str, Any]) -> float:
    """The largest whole part of ``dt`` that divides all delays.

    The reference may take any step, for its result does not depend on it.
    """
    dt = float(arguments["dt"])
    delays = [arguments.get(name) for name in (*LATENCIES, "sensor_period")]
    parts = (dt / count for count in range(1, FINEST_DIVISION + 1))
    fits = (part for part in parts if all(is_multiple(float(x), part) for x in delays if x))
    return next(fits, dt)


def whole_multiple(name: str, value: float, unit_name: str, unit: float, least: int = 1) -> int:
    """How many ``unit`` make up ``value``.

    Raises:
        ValueError: if ``value`` is no whole multiple of ``unit``, naming the nearest valid values.
    """
    ratio = value / unit
    if ratio > MOST:
        raise InputError(
            f"`{name}`={value:.12g} s is more than {MOST:.0e} times `{unit_name}`={unit:.12g} s; "
            f"give a longer `{unit_name}`"
        )
    count = round(ratio)
    if count >= least and is_multiple(value, unit):
        return count
    below = max(least, math.floor(ratio))
    nearest = " or ".join(f"{n * unit:.12g}" for n in (below, below + 1))
    kept = "" if value <= 0.0 else f"; or keep it, with `{unit_name}` {_parts(value, ratio)} s"
    raise InputError(
        f"`{name}`={value:.12g} s is not a whole multiple of `{unit_name}`={unit:.12g} s; "
        f"nearest valid: {nearest} s{kept}"
    )


def check_divides(name: str, value: float, whole_name: str, whole: float) -> None:
    """Check that a time that is given is a whole part of one that cannot be chosen.

    Raises:
        ValueError: if ``whole`` is no whole multiple of ``value``, naming the nearest valid values.
    """
    ratio = whole / value
    if ratio <= MOST and (round(ratio) < 1 or not is_multiple(whole, value)):
        raise InputError(
            f"`{name}`={value:.12g} s does not divide {whole_name} of {whole:.12g} s into whole "
            f"steps; nearest valid: {_parts(whole, ratio)} s"
        )


def _parts(whole: float, ratio: float) -> str:
    """The whole parts of a time that are nearest to the one that goes into it ``ratio`` times."""
    below = math.floor(ratio)
    return " or ".join(f"{whole / n:.12g}" for n in (below + 1, below) if n)


def _check_within(name: str, value: float, duration: float) -> None:
    if value > duration * (1.0 + TOLERANCE):
        raise InputError(
            f"`{name}`={value:.12g} s is longer than an episode, `duration`={duration:.12g} s; all "
            "times are in seconds"
        )


@dataclass(frozen=True)
class Timing:
    """Rates of one environment, in seconds and in sub-steps of ``dt``.

    Attributes:
        dt: integration step, s.
        control_period: time between two decisions, s.
        substeps: integration steps per decision.
        latency: action latency in integration steps.
        sensor: integration steps between two sensor samples, or None for one per decision.
        horizon: decisions until truncation.
        delay: the latency as (whole decisions, sub-steps beyond them).
        memory: past commands to keep: those still under way, and the last one to hold.
        sight: the observation latency as (whole decisions, sub-steps beyond them).
        jitter: most integration steps by which a command is later than the latency.
        hold: probability that a command does not arrive.
        samples: observations to keep on their way, at least the whole decisions of `sight`.
    """

    dt: float
    control_period: float
    substeps: int
    latency: int
    sensor: int | None
    horizon: int
    delay: tuple[int, int]
    memory: int
    sight: tuple[int, int] = (0, 0)
    jitter: int = 0
    hold: float = 0.0
    samples: int = 0

    @property
    def drawn(self) -> bool:
        """Whether it is drawn for every command when it arrives, or whether it does."""
        return bool(self.jitter or self.hold)

    @classmethod
    def of(
        cls,
        dt: float,
        control_period: float | None,
        action_latency: float,
        sensor_period: float | None,
        duration: float,
        observation_latency: float = 0.0,
        latency_jitter: float = 0.0,
        hold_probability: float = 0.0,
    ) -> Timing:
        """Check the times against each other and count them.

        Raises:
            ValueError: if one of them is no whole multiple of ``dt``, or if an episode has not one
                whole control period or ends before the first command acts.
        """
        period = dt if control_period is None else control_period
        _check_within("control_period" if control_period else "dt", period, duration)
        substeps = whole_multiple("control_period", period, "dt", dt)
        late_by = []
        latencies = action_latency, observation_latency, latency_jitter
        for name, value in zip(LATENCIES, latencies, strict=True):
            _check_within(name, value, duration)
            late_by.append(whole_multiple(name, value, "dt", dt, least=0))
        latency, sight, jitter = late_by
        sensor = None
        if sensor_period is not None:
            sensor = whole_multiple("sensor_period", sensor_period, "dt", dt)
            late = "observation_latency` under a `sensor_period"
            whole_multiple(late, observation_latency, "control_period", period, least=0)
        if duration / period > MOST:
            raise InputError(
                f"`duration`={duration:.12g} s is more than {MOST:.0e} control periods of "
                f"{period:.12g} s; give a shorter one"
            )
        horizon = max(1, math.ceil(duration / period * (1.0 - TOLERANCE)))
        return cls(
            dt, period, substeps, latency, sensor, horizon,
            delay=divmod(latency, substeps),
            memory=max(1, -(-(latency + jitter) // substeps)),
            sight=divmod(sight, substeps),
            jitter=jitter,
            hold=hold_probability,
            samples=sight // substeps,
        )  # fmt: skip


@dataclass(frozen=True)
class Settings:
    """The arguments that all environments have in common."""

    integrator: str = parameter(
        "rk4", "", "one-step map such as `rk4`, as the engine calls it, or `module:Class`", text
    )
    dt: float = parameter(0.05, "s", "integration step", positive)
    control_period: float | None = parameter(
        None,
        "s",
        "time between two decisions, a whole multiple of `dt`; `None`: `dt`",
        optional(positive),
    )
    engine: str = parameter(
        NATIVE, "", "what advances the plant: ours, or a simulator such as `mujoco`", text
    )
    solver: Mapping[str, Any] | None = parameter(
        None,
        "",
        "settings of the engine's solver, in its own names; `None`: the engine's defaults",
        optional(plain_table),
    )
    duration: float = parameter(
        10.0, "s", "truncation after ceil(duration / control_period) decisions", positive
    )
    action_latency: float = parameter(
        0.0, "s", "delay of every command, a whole multiple of `dt`", nonnegative
    )
    latency_jitter: float = parameter(
        0.0,
        "s",
        "largest further delay of a command, drawn for each, a whole multiple of `dt`",
        nonnegative,
    )
    hold_probability: float = parameter(
        0.0,
        "1",
        "probability that a command does not arrive, so that the one before it stays in force",
        probability,
    )
    observation_latency: float = parameter(
        0.0,
        "s",
        "age of every sample that is shown, a whole multiple of `dt`, or of `control_period` if "
        "there is a `sensor_period`",
        nonnegative,
    )
    sensor_period: float | None = parameter(
        None,
        "s",
        "time between two samples, a whole multiple of `dt`; `None`: one per decision",
        optional(positive),
    )
    observation_noise: float = parameter(
        0.0, "SI", "standard deviation of each sensed state component", nonnegative
    )
    fallback: str = parameter(
        "hold",
        "",
        "`hold` the last control or `zero`, where no valid command acts",
        one_of("hold", "zero"),
    )
    max_speed: float | None = parameter(
        None, "rad/s, m/s", "clip on every velocity; `None`: no clip", optional(positive)
    )
    start: str = parameter("", "", "start distribution", text)
    contact: str = parameter(
        "compliant",
        "",
        "law of the stops: ours, the same in every engine, or `engine`",
        one_of("compliant", "engine"),
    )


@dataclass(frozen=True)
class Setup:
    """Everything that one discretization of an environment is made of."""

    settings: Settings
    timing: Timing
    plant: Plant
    task: Task
    system: PlantSystem
    engine: Engine

    def __getstate__(self) -> dict[str, Any]:
        """Without a simulator, which is made anew of the rest."""
        engine = self.engine if self.settings.engine == NATIVE else type(self.engine)
        return {**vars(self), "engine": engine}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        if isinstance(self.engine, type):
            vars(self)["engine"] = _engine(self.settings, self.system, self.timing.dt)

    @property
    def fingerprinted(self) -> str:
        """The plant on which the engine's fingerprint is taken."""
        return self.task.plant

    @property
    def action_space(self) -> spaces.Box | spaces.Discrete:
        """`Discrete`, or a `Box` of one entry per control, in their units."""
        if self.task.discrete is not None:
            return spaces.Discrete(self.task.discrete)
        low = np.array([np.min(low) for low, _ in self.task.control_limits], dtype=np.float32)
        high = np.array([np.max(high) for _, high in self.task.control_limits], dtype=np.float32)
        return spaces.Box(low, high, dtype=np.float32)

    @property
    def action_size(self) -> int:
        """Entries of an action: one per control of a `Box`, the choice of a `Discrete`."""
        return 1 if self.task.discrete is not None else len(self.plant.controls)

    @property
    def largest_controls(self) -> tuple[float, ...]:
        """Largest magnitude of each control in any lane, in its unit."""
        return tuple(float(np.max(np.abs(ends))) for ends in self.task.control_limits)

    @property
    def energy_at_goal(self) -> float:
        """Energy at rest at the goal, J; 0.0 where zero is not at the goal."""
        rest = (0.0,) * len(self.plant.coordinates)
        if not np.any(self.task.at_goal(SCALAR, rest, rest)):
            return 0.0
        return float(np.max(self.plant.energy(SCALAR, rest, rest)))

    def arguments(self) -> dict[str, Any]:
        """All constructor arguments with their values, defaults included."""
        parts = (self.settings, self.plant, self.task)
        return {f.name: getattr(part, f.name) for part in parts for f in fields(part)}  # type: ignore[arg-type]

    def units(self) -> dict[str, str]:
        """SI unit of every constructor argument."""
        return {**units(self.settings), **units(self.plant), **units(self.task)}

    def limited(self, max_episode_steps: int) -> Setup:
        """The same setup with episodes of at most so many decisions, which shortens `duration`.

        -1 is for no limit, as in Gymnasium: `duration` is the longest that there is.

        Raises:
            ValueError: for more than `duration` has, or less than one.
        """
        settings, horizon = self.settings, self.timing.horizon
        if max_episode_steps == -1:
            horizon = max_episode_steps = NO_LIMIT
        whole = isinstance(max_episode_steps, (int, np.integer))
        if not (whole and 1 <= max_episode_steps <= horizon):
            raise InputError(
                f"`max_episode_steps` must be from 1 to {horizon}, the decisions in "
                f"`duration`={settings.duration:g} s, got {max_episode_steps!r}; for longer "
                "episodes give a longer `duration`, or -1 for no limit"
            )
        if max_episode_steps == self.timing.horizon:
            return self
        other = replace(settings, duration=int(max_episode_steps) * self.timing.control_period)
        return replace(self, settings=other, timing=timing_of(other)).with_memory_of(self.timing)

    def with_memory_of(self, other: Timing) -> Setup:
        """The same setup, which keeps as many commands and observations as another timing."""
        timing = replace(self.timing, memory=other.memory, samples=other.samples)
        return self if timing == self.timing else replace(self, timing=timing)

    def with_values(
        self, plant: Plant, task: Task, timing: Timing, max_speed: Component | None
    ) -> Setup:
        """The same setup for other values, which are not looked at and may be traced.

        Args:
            plant: of the same class, as ``task``.
            timing: rates.
            max_speed: clip on every velocity, rad/s or m/s, or None.
        """
        system = _system(self.settings, plant, task, max_speed)
        if self.engine.batched:
            engine = self.engine.at(system, timing.dt)
        else:
            engine = _engine(self.settings, system, timing.dt)
        return replace(self, plant=plant, task=task, timing=timing, system=system, engine=engine)


def build_setup(
    plant: type[Any], task: type[Any], defaults: Mapping[str, Any], arguments: Mapping[str, Any]
) -> Setup:
    """Build the setup of an environment from its constructor arguments.

    Args:
        plant: plant class.
        task: task class.
        defaults: the environment's own defaults, by argument name.
        arguments: what the user gave; plant parameters may be arrays, one value per lane.

    Raises:
        TypeError: for an unknown argument, with the valid names.
        ValueError: for an impossible value, with the valid choices.
    """
    actuator = {**defaults, **arguments}.get("actuator", "effort")
    if actuator not in ("effort", "position"):
        raise InputError(unknown_name("actuator", actuator, ("effort", "position")))
    if actuator == "position":
        if getattr(plant, "input_forces", None) is not None:
            raise InputError(
                f"`actuator`='position' puts servos on driven coordinates, and controls of the "
                f"plant {plant.name!r} act otherwise; leave it out"
            )
        plant, task = with_servo(plant), with_targets(task)  # type: ignore[arg-type]
    elif "actuator" in defaults:
        plant = with_efforts(plant)  # type: ignore[arg-type]
    names = {"actuator", *(f.name for part in (Settings, plant, task) for f in fields(part))}
    for name in arguments:
        if name == "max_episode_steps":
            raise InputTypeError(
                "the environment got an unexpected keyword argument 'max_episode_steps', which "
                "gym.make and gym.make_vec take; here give `duration`, s"
            )
        if name in SERVO_ARGUMENTS and actuator == "effort":
            raise InputTypeError(f"`{name}` is of servos; give `actuator`='position' with it")
        if name not in names:
            raise InputTypeError(
                f"the environment got an unexpected keyword argument {name!r}. "
                f"{suggestion(name, names)}"
            )
    values = {
        name: value.item()
        if isinstance(value, np.generic | np.ndarray) and not value.ndim
        else value
        for name, value in {**defaults, **arguments}.items()
    }
    given = _parse(Settings, values)
    settings = replace(given, start=given.start or task.starts[0])
    if settings.start not in task.starts:
        raise InputError(unknown_name("start", settings.start, task.starts))
    timing = timing_of(settings)
    the_plant = _parse(plant, values)
    if settings.max_speed is not None and settings.max_speed > DIVERGENCE_SPEED:
        raise InputError(
            f"`max_speed`={settings.max_speed} is above {DIVERGENCE_SPEED:g}, where a motion "
            "counts as diverged; give a smaller limit or None"
        )
    if settings.contact == "engine" and getattr(the_plant, "stops", None) is None:
        remedy = "give its limit" if hasattr(the_plant, "stopped") else "leave `contact` out"
        if getattr(the_plant, "contacts", ()):
            remedy = (
                "its contact points have our law in every engine, and the engines' own are "
                "measured by benchmarks/engine_contact.py (docs/reference/environments.md, "
                '"Contact of other engines")'
            )
        raise InputError(
            f"`contact`='engine' needs stops, and this {the_plant.name} has none; {remedy}"
        )
    the_task = _parse(task, values)
    system = _system(settings, the_plant, the_task, settings.max_speed)
    servo = system.servo or system.sampler
    if servo is not None:
        _check_servo(servo, timing)
    engine = _engine(settings, system, timing.dt)
    return Setup(settings, timing, the_plant, the_task, system, engine)


def _system(settings: Settings, plant: Any, task: Any, max_speed: Component | None) -> PlantSystem:
    servo = plant.servo_of(task.effort_limits) if isinstance(plant, ServoPlant) else None
    return PlantSystem(plant, max_speed, settings.contact == "engine", servo)


def _check_servo(servo: Servo, timing: Timing) -> None:
    """Refuse a period of a sampled servo that is missing, or that rates do not divide."""
    if isinstance(servo.period, np.ndarray):
        raise InputError("`servo_period` must be one value for all environments, got an array")
    if (servo.period is None) == (servo.when == "period"):
        raise InputError(
            "`servo_period` is for `servo`='period', and needed there: the time between two "
            "measurements of the servo, s"
        )
    if servo.period is not None:
        whole_multiple("servo_period", servo.period, "dt", timing.dt)
        whole_multiple("control_period", timing.control_period, "servo_period", servo.period)


def _engine(settings: Settings, system: PlantSystem, dt: Component) -> Engine:
    return make_engine(settings.engine, system, settings.integrator, dt, settings.solver)


def timing_of(settings: Settings) -> Timing:
    """The rates of an environment; see :meth:`Timing.of`."""
    names = ("dt", "control_period", "sensor_period", "duration", "hold_probability", *LATENCIES)
    return Timing.of(**{name: getattr(settings, name) for name in names})


def _parse(owner: type[Any], values: Mapping[str, Any]) -> Any:
    own = {f.name: values[f.name] for f in fields(owner) if f.name in values}
    for name, value in own.items():
        if owner is Settings and isinstance(value, (np.ndarray, list, tuple)):
            kind = "an array" if isinstance(value, np.ndarray) else repr(value)
            raise InputError(
                f"`{name}` must be one value for all environments, got {kind}; parameters "
                "of the plant and the task may be arrays in gym.make_vec, and its `mixture` is a "
                "list of discretizations"
            )
        elements = value.ravel().tolist() if isinstance(value, np.ndarray) else [value]
        for element in elements:
            check_values(owner, {name: element})
    return owner(**{name: _as_float(value) for name, value in own.items()})


def _as_float(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.astype(np.float64)
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value


WEIGHT = "weight"
"""Key of a member's weight: its share is its weight over the sum of all; 1 where it is left out."""


@dataclass(frozen=True)
class Mixture:
    """The discretizations of an environment; an environment without a mixture has one.

    Attributes:
        setups: one per member; they differ in engine, integrator, ``dt`` and control period alone,
            and keep equally many commands and observations.
        shares: of each member, adding up to 1: of the episodes.
    """

    setups: tuple[Setup, ...]
    shares: tuple[Fraction, ...] = (Fraction(1),)

    @property
    def periods(self) -> tuple[float, ...]:
        """Control period of each member, s."""
        return tuple(setup.timing.control_period for setup in self.setups)

    @property
    def several_periods(self) -> bool:
        """Whether its members decide at different control periods."""
        return len(set(self.periods)) > 1

    @property
    def mean_period(self) -> float:
        """Mean of the control periods by the shares, s; the one that all have, to the last bit."""
        pairs = zip(self.periods, self.shares, strict=True)
        return float(sum(Fraction(period) * share for period, share in pairs))

    @property
    def horizon(self) -> int:
        """Decisions of the longest episode."""
        return max(setup.timing.horizon for setup in self.setups)

    def limited(self, max_episode_steps: int | None) -> Mixture:
        """The same with episodes of at most so many decisions; see :meth:`Setup.limited`.

        Members that have fewer anyway stay as they are.
        """
        if max_episode_steps is None:
            return self
        most = -1
        if max_episode_steps != -1:
            longest = max(self.setups, key=lambda setup: setup.timing.horizon)
            most = longest.limited(max_episode_steps).timing.horizon
        setups = (setup.limited(min(most, setup.timing.horizon)) for setup in self.setups)
        return replace(self, setups=tuple(setups))

    def member(self, number: float) -> int:
        """The member that a number drawn from [0, 1) stands for."""
        *bounds, _ = accumulate(self.shares)
        return bisect_right(bounds, number)


def make_mixture(
    make_setup: Callable[[Mapping[str, Any]], Setup],
    arguments: Mapping[str, Any],
    members: Any,
) -> Mixture:
    """Parse the ``mixture`` argument of an environment.

    Args:
        make_setup: gives the setup of constructor arguments.
        arguments: the other constructor arguments.
        members: dicts of ``integrator``, ``dt``, … and, optionally, ``weight``; None: no mixture.

    Raises:
        TypeError, ValueError: for what is no list of such dicts, for impossible values, and for
            several control periods that follow from ``dt`` without being said.
    """
    if members is None:
        return Mixture((make_setup(arguments),))
    places, shares = parse_mixture(arguments, members)
    setups = tuple(make_setup(place) for place in places)
    memory, samples = (max(getattr(s.timing, n) for s in setups) for n in ("memory", "samples"))
    kept = replace(setups[0].timing, memory=memory, samples=samples)
    mixture = Mixture(tuple(setup.with_memory_of(kept) for setup in setups), shares)
    stated = all(place.get("control_period") is not None for place in places)
    if mixture.several_periods and not stated:
        raise InputError(
            f"members of `mixture` decide every {sorted(set(mixture.periods))} s, for without a "
            "control period they decide at every step; give `control_period`, one for all or one "
            "in each member"
        )
    return mixture


def parse_mixture(
    arguments: Mapping[str, Any], members: Any
) -> tuple[list[dict[str, Any]], tuple[Fraction, ...]]:
    """The constructor arguments of each member of a mixture, and the members' shares.

    Args:
        arguments: of all members.
        members: see :func:`make_mixture`.

    Raises:
        ValueError: for what is no list of members, and for an argument that each has of its own.
    """
    checked = _check_members(members)
    for name in DISCRETIZATION:
        if name in arguments and all(name in member for member in checked):
            raise InputError(
                f"`{name}`={arguments[name]!r} has no effect, because each member of `mixture` has "
                "its own; leave one of them out"
            )
    weights = [Fraction(str(member.get(WEIGHT, 1))) for member in checked]
    places = [{**arguments, **{k: x for k, x in m.items() if k != WEIGHT}} for m in checked]
    return places, tuple(weight / sum(weights) for weight in weights)


def _check_members(members: Any) -> Sequence[Mapping[str, Any]]:
    """Dicts with nothing but known keys, and possible weights."""
    if isinstance(members, str | Mapping) or not isinstance(members, Sequence):
        raise InputError(f"`mixture` must be a list of discretizations, got {members!r}")
    if not members:
        raise InputError("`mixture` must list at least one discretization, got none")
    for member in members:
        if not isinstance(member, Mapping):
            raise InputError(
                f'every member of `mixture` must be like {{"integrator": "rk4", "dt": 0.01}}, got '
                f"{member!r}"
            )
        for name in member:
            if name not in (*DISCRETIZATION, WEIGHT):
                raise InputError(unknown_name("key in `mixture`", name, (*DISCRETIZATION, WEIGHT)))
        wrong = positive(member.get(WEIGHT, 1.0))
        if wrong:
            raise InputError(f"`{WEIGHT}` in `mixture` {wrong}, got {member[WEIGHT]!r}")
    return members
