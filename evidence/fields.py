"""The fields of a record and the columns of its trace: names, units, meanings, origins."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from math import gcd
from operator import attrgetter, methodcaller
from typing import Any

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.foreign import Further
from integ_gym.envs.plants.interface import state_names, state_units
from integ_gym.envs.settings import DRAWN, NATIVE, Setup
from integ_gym.envs.transition import STATUS_NAMES, control_columns, effort_columns
from integ_gym.support.errors import InputError, InputTypeError
from integ_gym.support.optional import installed_versions
from integ_gym.support.processes import host

_PACKAGES = ("integ-gym", "gymnasium", "numpy")


def recorded_arguments(setup: Any) -> dict[str, Any]:
    """All constructor arguments with their values, but for drawn delays of 0 and no `solver`.

    So records without them are what they were before there were any.
    """
    later = (*DRAWN, "solver")
    return {name: x for name, x in setup.arguments().items() if name not in later or x}


def arguments(setup: Setup, lane: int) -> str:
    """JSON of {name: {"value": …, "unit": …}} for the arguments that are recorded."""
    values, units = recorded_arguments(setup), setup.units()
    return json_text(
        {name: {"value": _of_lane(values[name], lane), "unit": units[name]} for name in values}
    )


def engine_description(setup: Setup, _: int) -> str:
    """What the engine says of itself, and what it was measured to be, if it is not ours; JSON."""
    settings, described = setup.settings, setup.engine.describe()
    if settings.engine not in (NATIVE, None) and setup.fingerprinted is not None:
        solver = tuple((settings.solver or {}).items())
        method = settings.engine, settings.integrator
        measured = numerics.fingerprint(*method, setup.fingerprinted, solver)
        described = {**described, "fingerprint": measured.to_json()}
    testbed = getattr(setup, "testbed", None)
    return json_text(described if testbed is None else {**described, "testbed": testbed})


def sensor_period(setup: Setup, _: int) -> float | None:
    """Time between two samples, s; None where it is not known."""
    timing = setup.timing
    if timing.dt is None:
        return None
    return (timing.substeps if timing.sensor is None else timing.sensor) * timing.dt


def action_latency(setup: Setup, _: int) -> float | None:
    """Delay of every command, s; None where it is not known."""
    timing = setup.timing
    return None if timing.dt is None else timing.latency * timing.dt


def staleness(setup: Setup) -> float:
    """Action and observation latency plus the greatest age of a sample at a decision, s.

    Jitter counts in full, and commands that may not arrive as one control period. 0 where nothing
    is known of either.
    """
    timing = setup.timing
    if timing.dt is None:
        return 0.0
    age = 0 if timing.sensor is None else timing.sensor - gcd(timing.sensor, timing.substeps)
    periods, rest = timing.sight
    late = timing.latency + timing.jitter + (timing.substeps if timing.hold else 0)
    return (late + periods * timing.substeps + rest + age) * timing.dt


def in_words(fields: Mapping[str, Any]) -> str:
    """Engine, integrator and steps in words, from the record's fields of these names."""
    if fields["engine"] is None:
        return "an engine that is not known"
    return (
        f"{fields['integrator']} ({fields['engine']}) at dt {fields['dt']:.6g} s and control "
        f"period {fields['control_period']:.6g} s"
    )


def package_versions(further: Mapping[str, str]) -> dict[str, str]:
    """Versions of Python, of what integ-gym always needs, and of ``further`` packages."""
    return {**installed_versions(_PACKAGES), **further}


def json_text(value: Any) -> str:
    """JSON with sorted keys and no spaces; NumPy numbers as Python's own."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), default=_plain)


def optional_json(value: Any) -> str | None:
    """The same, or None for None."""
    return None if value is None else json_text(value)


def _of_lane(value: Any, lane: int) -> Any:
    return value[lane].item() if isinstance(value, np.ndarray) else value


def _plain(value: Any) -> Any:
    try:
        return value.tolist()
    except AttributeError:
        raise InputTypeError(f"{value!r} cannot be written as JSON") from None


@dataclass(frozen=True)
class Origin:
    """How the values of a field are found.

    Attributes:
        of: what they are read from: ``context``, an episode's
            :class:`~integ_gym.evidence.labels.EpisodeContext`; ``setup``, its setup and
            lane; ``head``, the :class:`~integ_gym.evidence.episodes.EpisodeHeads`
            of many episodes and all contexts; ``rows``, the
            :class:`~integ_gym.evidence.episodes.EpisodeRows` of many episodes.
        value: function of that to the value; of many episodes to one value per episode, of rows
            as an array.
    """

    of: str
    value: Callable[..., Any]


def _origin(of: str, what: str | Callable[..., Any]) -> Origin:
    """``what``: a function, or the name of an attribute, with dots for one of an attribute."""
    if callable(what):
        return Origin(of, what)
    get = attrgetter(what)
    return Origin(of, lambda owner, *_: get(owner))


context = partial(_origin, "context")
"""Of what the recorder is given of the episodes."""

setup = partial(_origin, "setup")
"""Of the environment's setup, and the lane whose plant parameters hold."""

head = partial(_origin, "head")
"""Of what identifies the episodes, and all contexts."""

rows = partial(_origin, "rows")
"""Of the rows of whole episodes."""


def _of_entry(method: str) -> Callable[[str], Origin]:
    """What a method of :class:`~integ_gym.evidence.episodes.EpisodeRows` makes of an entry."""
    return lambda entry: rows(methodcaller(method, entry))


total, most, first, last = map(_of_entry, ("total", "most", "first", "last"))


SCHEMA_VERSION = 7

FIRST_WRITTEN = 4
"""Earliest schema version that this version of integ-gym wrote; as much is asked of its files."""

CODED_REASONS = 5
"""Schema version since which a reason is a code with numbers; before, it is a sentence."""

SECOND_HORIZON, ATTEMPT, LATER_ATTEMPT = "second_horizon", "attempt", "attempt_second_horizon"

PHASES = ("training", "evaluation", SECOND_HORIZON, ATTEMPT, LATER_ATTEMPT)
"""A training; an evaluation, and the same with twice the time; a hand-made controller that tries a
cell before any policy is judged in it, and the same with twice the time."""

LABELS = (
    "none",
    "evaluation_error",
    "contract_error",
    "unachievable",
    "not_learned",
    "too_slow",
    "discretization_error",
    "perception_error",
    "state_error",
    "control_error",
    "planning_error",
    "unattributed",
)


CELL_STATUSES = ("achievable", "too_slow", "unachievable", "undecided")
"""Whether a cell can be solved within the horizon; only within two; not within two; not known."""


@dataclass(frozen=True)
class Field:
    """One column of the evidence.

    Attributes:
        name: column name.
        kind: string, json (text that holds JSON), bool, int32, int64, float64, timestamp (UTC), or
            list<float64>, list<float32>, list<int32>, list<int8>.
        unit: SI unit; 1 for a dimensionless number, empty for what is no number.
        meaning: one line.
        origin: where the values come from; None for a trace column, and for what is known of whole
            records alone.
        group: heading under which it is shown; ``trace`` for trace columns.
        nullable: whether it may be null.
        volatile: whether the content hash leaves it out.
        frame: reference frame of a position, velocity, force or torque.
        choices: the values a string may have; one that is made of rows is a place among them.
        at: ``instant`` (a value at every control instant) or ``step`` (a value for every control
            step); empty outside the trace.
        source: name of the row entry that a trace column is made of; see
            :class:`integ_gym.evidence.episodes.Layout`.
        since: schema version that brought it; null in records of earlier ones.
    """

    name: str
    kind: str
    unit: str
    meaning: str
    origin: Origin | None = None
    group: str = ""
    nullable: bool = False
    volatile: bool = False
    frame: str = ""
    choices: tuple[str, ...] = ()
    at: str = ""
    source: str = ""
    since: int = 1


def _field(
    name: str, kind: str, unit: str, meaning: str, origin: Origin | None = None, **about: Any
) -> Field:
    """A field; one whose name ends with a question mark may be null."""
    about = {"nullable": name.endswith("?"), **about}
    return Field(name.rstrip("?"), kind, unit, meaning, origin, **about)


def _of_kind(kind: str, unit: str, **about: Any) -> Callable[..., Field]:
    return lambda name, meaning, origin=None, **more: _field(
        name, kind, unit, meaning, origin, **about, **more
    )


def _real(name: str, unit: str, meaning: str, origin: Origin, **about: Any) -> Field:
    return _field(name, "float64", unit, meaning, origin, **about)


_text, _json, _flag = (_of_kind(kind, "") for kind in ("string", "json", "bool"))
_count, _time = _of_kind("int64", "1"), _of_kind("timestamp", "", volatile=True)


def _record_ids(heads: Any, contexts: Any) -> list[str]:
    owned = zip(heads.context, heads.index, strict=True)
    return [contexts[context].record_id(index) for context, index in owned]


def _seeds(heads: Any, _: Any) -> list[int | None]:
    """The seeds of episodes, where 64 bits hold them."""
    return [x if x is not None and -(2**63) <= x < 2**63 else None for x in heads.seed]


def _group(name: str, *fields: Field) -> tuple[Field, ...]:
    return tuple(replace(field, group=name) for field in fields)


_IDENTITY = _group(
    "identity",
    _text("record_id",
        "hash of cell, policy and episode index, and of a phase that is no training or evaluation",
        head(_record_ids)),
    _count("schema_version", "version of this table", context(lambda _: SCHEMA_VERSION)),
    _text("run_id", "the run that the record belongs to", context("run_id")),
    _text("phase", "what the episode was for", context("phase"), choices=PHASES),
    _text("env_id", "Gymnasium id of the environment", None),
    _text("cell", "key of the panel cell or training run", context("cell")),
    _count("episode_index", "number of the episode in its cell, from 0", head("index")),
    _count("seed?",
        "seed given at the reset that seeded the generator; null if none was, if that reset was "
        "given a start or its bounds, or beyond 64 bits",
        head(_seeds)),
    _text("rng_key",
        "`entropy/n`: what seeded the generator, and how many episodes it had started before",
        head("rng_key")),
    _field("initial_state", "list<float64>", "SI", "true state at time 0, in state order",
        rows(lambda episodes: episodes.starts()), frame="plant"),
)  # fmt: skip

_DISCRETIZATION = _group(
    "discretization",
    _text("engine?", "what advanced the plant", setup("settings.engine")),
    _text("engine_version?", "version of the engine", setup("engine.version")),
    _json("engine_description", "the engine's float width, map, fingerprint and stops; "
        "`resistance`, where the force of our stops and friction acts; `testbed`, what made the "
        "environment; why no constraint is "
        "violated", setup(engine_description)),
    _text("integrator?", "one-step map, as the engine calls it", setup("settings.integrator")),
    _real("dt?", "s", "integration step", setup("timing.dt")),
    _real("control_period?", "s", "time between two decisions", setup("timing.control_period")),
    _count("substeps?", "integration steps per decision", setup("timing.substeps")),
    _real("sensor_period?", "s", "time between two sensor samples", setup(sensor_period)),
    _real("action_latency?", "s", "delay of every command", setup(action_latency)),
    _real("observation_noise?", "SI", "standard deviation of the sensor noise",
        setup("settings.observation_noise")),
    _real("solver_tolerance?", "1",
        "scaled residual beyond which a solution is not converged; null: no solver",
        setup(lambda own, _: own.engine.solver().get("solver_tolerance"))),
    _count("solver_cap?", "most solver iterations per integration step; null: no solver",
        setup(lambda own, _: own.engine.solver().get("solver_cap"))),
    _real("duration?", "s", "time until truncation", setup("settings.duration")),
    _text("fallback?", "control where no valid command acted", setup("settings.fallback")),
    _real("max_speed?", "SI", "clip on every velocity; null: no clip", setup("settings.max_speed")),
    _text("start?", "start distribution", setup("settings.start")),
    _json("arguments", "all constructor arguments and plant parameters: name to value and unit",
        setup(arguments)),
)  # fmt: skip

_POLICY = _group(
    "policy",
    _text("policy_id", "name of the policy", context("policy_id")),
    _text("policy_hash", "hash of what decides its actions; empty in training",
        context("policy_hash")),
    _json("training_discretization?",
        "what the policy was trained on; null: not trained, or not known",
        context(lambda own: optional_json(own.training_discretization))),
    _count("training_seed?", "seed of its training; null: not trained", context("training_seed")),
    _json("perturbation?", "plant parameters changed in this cell; null: none",
        context(lambda own: optional_json(own.perturbation))),
)  # fmt: skip

_OUTCOME = _group(
    "outcome",
    _text("metric", "name of the metric", context(lambda _: "success")),
    _text("metric_definition", "what counts as success, with units", setup("task.goal")),
    _real("return?", "1", "sum of rewards; null if not finite", total("reward")),
    _flag("success?", "whether the metric was met", last("success")),
    _real("time_to_success?", "s",
        "start of the final unbroken stay at the goal; null without success",
        rows(lambda episodes: episodes.time_to_success())),
    _count("length", "control steps", rows(lambda episodes: episodes.steps)),
    _flag("terminated", "ended by the task or by a divergence", last("terminated")),
    _flag("truncated", "ended by the time limit", last("truncated")),
    _real("saturated_share?", "1",
        "share of control steps whose action, or effort of a servo, was saturated",
        rows(lambda episodes: episodes.total("saturated") / episodes.steps)),
    _count("fallback_count?", "control steps in which the fallback acted", total("fallback_used")),
    _count("recovery_count?", "control steps without fallback right after one with",
        rows(lambda episodes: episodes.falls("fallback_used"))),
    _real("penetration_max?", "m, rad", "deepest penetration of a stop; null: not reported",
        most("penetration")),
    _real("constraint_violation_max?", "m",
        "largest constraint violation; null: not reported, or none to violate",
        most("constraint_violation")),
    _real("command_error?", "SI",
        "root mean square over control steps of what is commanded minus what is measured, as a "
        "vector; null: not reported", rows(lambda episodes: episodes.command_error()), since=7),
    _text("failure_label", "first failure rule that fits", None, choices=LABELS),
    _text("failure_reason", "code of the reason; its sentence in schema version 4 and before",
        None),
    _json("failure_numbers?", "numbers of the reason, by name, in SI units", None,
        since=CODED_REASONS),
)  # fmt: skip

_replayed = _of_kind("bool", "", nullable=True, since=2)

_REPLAYS = _group(
    "replays",
    _replayed("replay_home", "whether the same policy succeeds from the same start at home, in a "
        "perturbed cell at home under the same perturbation; null: not run, or no other"),
    _replayed("replay_without_noise", "the same without observation noise; null: not run"),
    _replayed("replay_without_delay", "the same without latency and staleness; null: not run"),
    _replayed("replay_second_horizon", "whether the same policy succeeds from the same start "
        "within one duration or two; null: not run"),
    _field("home_success?", "float64", "1",
        "share of its starts from which the policy succeeds at home; null: not known", since=2),
    _field("cell_status?", "string", "", "whether the goal can be reached here: a hand-made "
        "controller may show it, a search rule it out; null: neither could be tried",
        choices=CELL_STATUSES, since=2),
    _flag("contract_kept?", "whether observation, command, force and acceleration are those of "
        "home at the same states, before any integration; null: not compared", since=6),
)  # fmt: skip

_LEDGER = _group(
    "ledger",
    _real("energy_start?", "J", "energy at time 0; zero at rest hanging", first("energy")),
    _real("energy_end?", "J", "energy at the end", last("energy")),
    _real("work_total?", "J", "work of the actuator", total("actuator_work")),
    _real("dissipated_total?", "J", "energy that damping took out; null: a loss is not known",
        total("dissipated")),
    _real("contact_loss_total?", "J", "energy that contact took out; null: not reported",
        total("contact_loss")),
    _real("clip_loss_total?", "J", "energy that the speed limit took out", total("clip_loss")),
    _real("energy_residual_total?", "J",
        "energy that numerical error put in; null: a loss is not known", total("energy_residual")),
    _real("energy_residual_abs_total?", "J",
        "sum of the residual's magnitude per step; null: a loss is not known",
        rows(lambda episodes: episodes.total("energy_residual", np.abs))),
)  # fmt: skip

_ARRIVAL = _group(
    "arrival",
    _real("arrival_time?", "s", "first control instant at the goal; null: never there",
        rows(lambda episodes: episodes.goal_reached()), since=3),
    _real("arrival_energy?", "J", "energy gained up to it", since=3,
        origin=rows(lambda episodes: episodes.at_arrival("energy") - episodes.first("energy"))),
    _real("arrival_residual?", "J", "energy that numerical error put in up to it; null: not known",
        rows(lambda episodes: episodes.until_arrival("energy_residual")), since=3),
)  # fmt: skip

_SOLVER = _group(
    "solver",
    _count("solver_iterations_max?", "most iterations in one integration step",
        most("solver_iterations")),
    _real("solver_iterations_mean?", "1",
        "mean over control steps of the most iterations in one integration step",
        rows(lambda episodes: episodes.total("solver_iterations") / episodes.steps)),
    _text("solver_status", "worst status of any control step", most("solver_status"),
        choices=STATUS_NAMES),
)  # fmt: skip

_PROVENANCE = _group(
    "provenance",
    _count("trace_every", "every n-th episode of its cell has a trace", context("trace_every")),
    _count("float_width?", "bits of the numbers that the physics was computed with",
        context("float_width")),
    _json("package_versions", "versions of the packages that matter",
        context(lambda own: json_text(package_versions(own.packages)))),
    _text("platform", "operating system and processor", context(lambda _: host()), volatile=True),
    _real("inference_latency_mean?", "ns",
        "mean time of one decision at batch size 1; null: not measured",
        context("inference_latency_mean"), volatile=True),
    _real("inference_latency_p99?", "ns", "99th percentile of the same; null: not measured",
        context("inference_latency_p99"), volatile=True),
    _real("latency_budget?", "s", "time there is for a decision: the control period",
        setup("timing.control_period")),
    _time("wall_start", "when the episode began", head("wall_start")),
    _time("wall_end", "when the episode ended", head("wall_end")),
    _text("content_hash", "SHA-256 over everything but the volatile fields", None, volatile=True),
)  # fmt: skip

SUMMARY_FIELDS: tuple[Field, ...] = (
    *_IDENTITY, *_DISCRETIZATION, *_POLICY, *_OUTCOME, *_REPLAYS, *_LEDGER, *_ARRIVAL, *_SOLVER,
    *_PROVENANCE
)  # fmt: skip
"""Every field that is not part of the trace, in the order of the columns."""

VOLATILE_NAMES = frozenset(field.name for field in SUMMARY_FIELDS if field.volatile)
"""Wall clock, latencies, host, and the content hash itself."""


_CODES = ", ".join(f"{code} {STATUS_NAMES[code]}" for code in range(-1, len(STATUS_NAMES) - 1))


def _column(
    name: str, kind: str, unit: str, meaning: str, at: str, source: str = "", frame: str = ""
) -> Field:
    return Field(
        name, f"list<{kind}>", unit, meaning, group="trace", nullable=True, frame=frame, at=at,
        source=source or name,
    )  # fmt: skip


COMMON_TRACE: tuple[Field, ...] = (
    _column("time", "float64", "s", "time since the start", "instant"),
    _column("sensor_time", "float64", "s", "when the sensed sample was taken", "instant"),
    _column("energy", "float64", "J", "kinetic plus potential energy", "instant"),
    _column("reward", "float64", "1", "reward", "step"),
    _column("work", "float64", "J", "work of the actuator", "step", "actuator_work"),
    _column("dissipated", "float64", "J", "energy that damping took out", "step"),
    _column("clip_loss", "float64", "J", "energy that the speed limit took out", "step"),
    _column("energy_residual", "float64", "J", "energy that numerical error put in", "step"),
    _column("solver_iterations", "int32", "1", "most iterations in one integration step", "step"),
    _column("solver_status_code", "int8", "1", f"codes: {_CODES}", "step", "solver_status"),
)
"""Trace columns of every environment."""

CONTACT_TRACE: tuple[Field, ...] = (
    _column("penetration", "float64", "m, rad", "deepest penetration of a stop", "step"),
    _column("contact_force", "float64", "N, N m", "contact force of largest magnitude", "step"),
    _column("contact_loss", "float64", "J", "energy that contact took out", "step"),
    _column("constraint_violation", "float64", "m", "largest constraint violation", "step"),
)
"""Zero without stops; null where an environment's `info` does not report it."""

_FORCE_UNITS = {"m": "N", "rad": "N m"}
"""Unit of a coordinate to that of its generalized force."""


def control_fields(plant: Any) -> Iterator[Field]:
    """Commanded and applied value of every control; ``info`` has a single one without its name."""
    asked = "control asked for by the decision, after saturation and fallback"
    given = "control in force at the end of the control step"
    own = hasattr(plant, "actuated")
    columns = control_columns(plant) if own else (("", "") for _ in plant.controls)
    for (name, unit), (commanded, applied) in zip(plant.controls, columns, strict=True):
        yield _column(f"{name}_commanded", "float64", unit, asked, "step", commanded, plant.frame)
        yield _column(f"{name}_applied", "float64", unit, given, "step", applied, plant.frame)
    meaning = "effort of the servo at the end of the control step"
    for name, place in effort_columns(plant):
        unit = _FORCE_UNITS[plant.coordinate_units[place]]
        yield _column(name, "float64", unit, meaning, "step", frame=plant.frame)


def contact_units(plant: Any) -> dict[str, str]:
    """Units of what is measured at contact points, or else along the stopped coordinate."""
    if hasattr(plant, "contact_names"):
        return {"penetration": "m", "penetration_max": "m", "contact_force": "N"}
    if not hasattr(plant, "actuated"):
        return {}
    unit = plant.coordinate_units[getattr(plant, "stopped", 0)]
    force = _FORCE_UNITS[unit]
    return {"penetration": unit, "penetration_max": unit, "contact_force": force}


_OF_CONTACT = (
    ("penetration", "m", "deepest penetration of a contact point, at the end of any sub-step"),
    ("normal_force", "N", "normal force on it"),
    ("tangential_force", "N", "force of friction on it, along the plane"),
    ("slip_speed", "m/s", "its speed along the plane; 0 where it does not touch"),
)
"""Of each contact point; all but the first at the end of the control step."""


def contact_fields(plant: Any) -> Iterator[Field]:
    """Columns of a plant's contact points; none without."""
    names: tuple[str, ...] = getattr(plant, "contact_names", ())
    column = partial(_column, kind="float64", at="step", frame=plant.frame)
    for name in names:
        for figure, unit, meaning in _OF_CONTACT:
            yield column(f"{name}_{figure}", unit=unit, meaning=meaning)
    if names:
        yield column("slip_loss", unit="J", meaning="what of the contact loss friction took")


def further_of(plant: Any) -> tuple[Further, ...]:
    """What else a plant reports of every control step; ours report nothing."""
    return tuple(getattr(plant, "further", ()))


def trace_fields(plant: Any, task: Any) -> tuple[Field, ...]:
    """Trace columns of one environment.

    Args:
        plant: plant or plant class.
        task: task or task class.
    """
    units, column = contact_units(plant), partial(_column, frame=plant.frame)
    states = zip(state_names(plant), state_units(plant), strict=True)
    observations = zip(task.observation_names, task.observation_units, strict=True)
    return (
        COMMON_TRACE[0],
        *(column(name, "float64", unit, "true state", "instant") for name, unit in states),
        *(
            column(f"sensed_{name}", "float32", unit, "observation", "instant")
            for name, unit in observations
        ),
        COMMON_TRACE[1],
        *control_fields(plant),
        *COMMON_TRACE[2:],
        *(
            replace(field, frame=plant.frame, unit=units.get(field.name, field.unit))
            for field in CONTACT_TRACE
        ),
        *contact_fields(plant),
        *(
            _column(further.name, "float64", further.unit, further.meaning, "step")
            for further in further_of(plant)
        ),
    )


def record_fields(plant: Any, task: Any) -> tuple[Field, ...]:
    """All columns of one environment's records.

    Raises:
        ValueError: if the plant or task names a component like another column.
    """
    units = {"initial_state": ", ".join(state_units(plant)), **contact_units(plant)}
    summary = tuple(
        replace(field, unit=units[field.name], frame=plant.frame) if field.name in units else field
        for field in SUMMARY_FIELDS
    )
    fields = (*summary, *trace_fields(plant, task))
    names = [field.name for field in fields]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(
            f"{plant.name}: evidence would have two columns named {', '.join(twice)}; "
            "rename the plant's or the task's component"
        )
    return fields
