"""Outcomes, ledger and label of a record, recomputed from its own trace and stored replays."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from math import gcd
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from integ_gym.envs.catalogue.lookup import environment_setup
from integ_gym.envs.ops.array_ops import ARRAY
from integ_gym.envs.plants.interface import split_state
from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.envs.settings import NATIVE
from integ_gym.envs.transition import STATUS_NAMES
from integ_gym.support.optional import installed_versions

from .context import EpisodeContext
from .differences import deviation, same
from .episode_log import told_setup
from .fields import CODED_REASONS, FIRST_WRITTEN, SUMMARY_FIELDS
from .labels import (
    EpisodeFacts,
    Replays,
    failure_label,
    failure_sentence,
    lacks_home,
)
from .record import EvidenceRecord
from .schema import EvidenceError, Finding, argument_values, parse_field

Array = npt.NDArray[Any]

TOLERANCE = {64: 1e-9, 32: 1e-5}
"""By float width: of sums over a trace, relative to the sum of their sizes."""

_SUMS = {
    "return": "reward",
    "work_total": "work",
    "dissipated_total": "dissipated",
    "contact_loss_total": "contact_loss",
    "clip_loss_total": "clip_loss",
    "energy_residual_total": "energy_residual",
}
"""Field to the trace column that it is the sum of."""

_LOSSES = ("dissipated_total", "contact_loss_total", "clip_loss_total")

_LEDGER_TOLERANCE = {64: 1e-9, 32: 1e-3}
"""By float width, relative to the sum of the terms' sizes: in 32 bits every step rounds each."""

_MOST = {"penetration_max": "penetration", "constraint_violation_max": "constraint_violation"}

_RESTORE = "restore the file from a copy"

UNFIT = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError)
"""What values of a stranger's end in, where others were expected."""

_Told = Callable[[str, Any, Any], Finding]

_ALIKE = ("control_error", "planning_error")
"""Labels that only a trace tells apart."""

_OF_TRACE = ("reached", "left", "since")
"""Numbers of reasons that only a trace gives."""


class _Course(NamedTuple):
    """What the rules of success and labels look at, in s; None where it never was."""

    reached: float | None
    left: float | None
    since: float | None
    success: bool
    terminated: bool
    truncated: bool


def recompute(record: EvidenceRecord, file: str) -> Iterator[Finding]:
    """What of a record is not what its trace and its replays make of it.

    Without a trace, only its length and what the label rests on are checked.

    Args:
        record: with its trace, if it has one.
        file: that it is in.
    """
    told = partial(deviation, file, str(record.fields["record_id"]))
    try:
        yield from list(_recomputed(record, told))
    except EvidenceError as error:
        yield Finding(file, str(record.fields["record_id"]), str(error))
    except UNFIT as error:
        message = f"cannot be recomputed ({error}): its values are not of this schema; {_RESTORE}"
        yield Finding(file, str(record.fields["record_id"]), message)


def _recomputed(record: EvidenceRecord, told: _Told) -> Iterator[Finding]:
    course = None
    yield from _told_otherwise(record.fields, told)
    every, index = record.fields["trace_every"], record.fields["episode_index"]
    if bool(record.trace) != (index % every == 0):
        fault = "it has a trace" if record.trace else "its trace is gone"
        raise EvidenceError(f"{fault}, at episode {index} with `trace_every` {every}; {_RESTORE}")
    if record.trace:
        length = len(record.trace["reward"])
        if record.fields["length"] != length:
            yield told("length", record.fields["length"], length)
            return
        for name, values in record.trace.items():
            if len(values) - length not in (0, 1):
                raise EvidenceError(
                    f"`{name}` has {len(values)} values in an episode of {length} control steps; "
                    f"{_RESTORE}"
                )
        for name, computed, scale in _from_trace(record):
            tolerance = TOLERANCE.get(record.fields["float_width"], TOLERANCE[32])
            if not same(record.fields[name], computed, tolerance, scale):
                yield told(name, record.fields[name], computed)
        course = course_of(record)
        if course is not None:
            for name in ("success", "terminated", "truncated"):
                if record.fields[name] != getattr(course, name):
                    yield told(name, record.fields[name], getattr(course, name))
            took = course.since if course.success else None
            if not same(record.fields["time_to_success"], took, 1e-9):
                yield told("time_to_success", record.fields["time_to_success"], took)
    elif record.fields["env_id"] in ENVIRONMENTS:
        if record.fields["success"] is None:
            yield told("success", None, "true or false")
        horizon = _setup(record.fields).timing.horizon
        if record.fields["length"] > horizon:
            yield told("length", record.fields["length"], horizon)
        truncated = record.fields["length"] >= horizon
        if record.fields["truncated"] != truncated:
            yield told("truncated", record.fields["truncated"], truncated)
    if record.fields["schema_version"] > 1:  # which did not keep what its labels rest on
        yield from _label(record, course, told)


def _told_otherwise(fields: Any, told: _Told) -> Iterator[Finding]:
    """Fields that follow from others of the same record, and are told otherwise."""
    expected: dict[str, Any] = {}
    expected["record_id"] = context_of(fields).record_id(fields["episode_index"])
    expected["metric"] = "success"
    if fields["phase"] == "training":
        expected |= {"policy_hash": "", "perturbation": None, **Replays().columns()}
    if not fields["success"]:
        expected["time_to_success"] = None
    if fields.get("arrival_time") is None:
        expected |= {"arrival_energy": None, "arrival_residual": None}
    expected |= _of_setup(fields)
    for name, wanted in expected.items():
        if name in fields and not same(fields[name], wanted, 1e-12):
            yield told(name, fields[name], wanted)
    yield from _of_ledger(fields, told)


def _of_setup(fields: Any) -> dict[str, Any]:
    """Fields that follow from the constructor arguments of one of our own environments.

    Nothing for another engine, code of somebody's own, or a record that another version made.
    """
    made_by = parse_field("package_versions", fields["package_versions"])
    here = installed_versions(["integ-gym"])
    if not isinstance(made_by, dict) or here.items() - made_by.items():
        return {}
    if fields["env_id"] not in ENVIRONMENTS:
        return {}
    given = argument_values(fields["arguments"])
    if given.get("engine", NATIVE) != NATIVE or any(":" in str(x) for x in given.values()):
        return {}
    found = _columns_of(fields["env_id"], fields["arguments"])
    narrow = fields["float_width"] != 64
    return {k: x for k, x in found.items() if not (narrow and k == "engine_description")}


@lru_cache(maxsize=256)
def _columns_of(env_id: str, arguments: str) -> dict[str, Any]:
    try:
        setup = environment_setup(env_id, argument_values(arguments))
    except (TypeError, ValueError) as error:
        raise EvidenceError(f"`arguments` make no environment: {error}; {_RESTORE}") from None
    own = (field for field in SUMMARY_FIELDS if field.origin and field.origin.of == "setup")
    return {field.name: field.origin.value(setup, 0) for field in own if field.origin}


def _of_ledger(fields: Any, told: _Told) -> Iterator[Finding]:
    """Energy at the end: that at the start, work and losses in between, and numerical error."""
    if fields["env_id"] not in ENVIRONMENTS:
        return
    parts = ("energy_start", "work_total", "energy_residual_total")
    gone = [x for x in (*parts, "energy_end", *_LOSSES) if fields[x] is None]
    if gone and _keeps_a_ledger(fields):
        yield from (told(name, None, "a number") for name in gone)
    known = [fields[name] for name in parts]
    if None in (*known, fields["energy_end"]):
        return
    lost = [fields[name] or 0.0 for name in _LOSSES]
    scale = sum(map(abs, (*known, *lost)))
    tolerance = _LEDGER_TOLERANCE.get(fields["float_width"], _LEDGER_TOLERANCE[32])
    computed = sum(known) - sum(lost)
    if not same(fields["energy_end"], computed, tolerance, scale):
        yield told("energy_end", fields["energy_end"], computed)
    absolute = fields["energy_residual_abs_total"]
    least = abs(fields["energy_residual_total"])
    if absolute is None or absolute < least * (1.0 - tolerance):
        yield told("energy_residual_abs_total", absolute, least)


def _keeps_a_ledger(fields: Any) -> bool:
    """Whether every entry is a number: our own engine reports all while the motion is finite."""
    own = fields["engine"] == NATIVE and fields["schema_version"] >= FIRST_WRITTEN
    return bool(own and fields["solver_status"] != "diverged")


def _from_trace(record: EvidenceRecord) -> Iterator[tuple[str, Any, float]]:
    """Field, what the trace makes of it, and what it was added up from."""
    trace = record.trace
    for name, column in _SUMS.items():
        values = trace.get(column)
        if values is not None:
            scale = float(np.abs(values).sum())
            yield name, _finite(values.sum()), scale if math.isfinite(scale) else 0.0
    if "energy_residual" in trace:
        size = _finite(np.abs(trace["energy_residual"]).sum())
        yield "energy_residual_abs_total", size, size or 0.0
    for name, column in _MOST.items():
        if column in trace:
            yield name, _finite(trace[column].max(initial=0.0)), 0.0
    if "energy" in trace:
        yield "energy_start", float(trace["energy"][0]), 0.0
        yield "energy_end", float(trace["energy"][-1]), 0.0
    if "solver_iterations" in trace:
        iterations = trace["solver_iterations"]
        yield "solver_iterations_max", _finite(iterations.max()), 0.0
        yield "solver_iterations_mean", _finite(iterations.mean()), 0.0
    yield "solver_status", STATUS_NAMES[int(trace["solver_status_code"].max())], 0.0
    if "time" in trace:
        yield "initial_state", [float(x[0]) for x in _states(record)], 0.0


def _states(record: EvidenceRecord) -> list[Array]:
    """The true state's columns, in state order: they come right after the time."""
    names = list(record.trace)
    first = names.index("time") + 1
    return [record.trace[name] for name in names[first : first + len(record["initial_state"])]]


def course_of(record: EvidenceRecord) -> _Course | None:
    """The way to the goal; None where the task is not one of ours."""
    fields = record.fields
    if fields["env_id"] not in ENVIRONMENTS:
        return None
    setup = _setup(fields)
    q, v = split_state(tuple(_states(record)))
    time = record.trace["time"]
    there = np.broadcast_to(np.asarray(setup.task.at_goal(ARRAY, q, v)), time.shape)
    arrived, left = np.flatnonzero(there), np.flatnonzero(there[:-1] & ~there[1:]) + 1
    away = np.flatnonzero(~there)
    since = None
    if there[-1]:
        since = float(time[away[-1] + 1]) if away.size else float(time[0])
    over = np.asarray(
        setup.task.terminated(ARRAY, tuple(x[-1:] for x in q), tuple(x[-1:] for x in v))
    )
    diverged = fields["solver_status"] == "diverged"
    terminated = bool(over.any()) or diverged
    truncated = fields["length"] >= setup.timing.horizon
    stayed = since is not None and time[-1] - since >= setup.task.goal_stay * (1.0 - 1e-4)
    return _Course(
        reached=float(time[arrived[0]]) if arrived.size else None,
        left=float(time[left[-1]]) if left.size else None,
        since=since,
        success=truncated and stayed and not terminated,
        terminated=terminated,
        truncated=truncated,
    )


def _setup(fields: Any) -> Any:
    """The setup of one of our environments, with its goal and times.

    Raises:
        EvidenceError: where there is none with the record's arguments.
    """
    try:
        return told_setup(fields["env_id"], fields["arguments"])
    except EvidenceError:
        raise
    except (TypeError, ValueError) as error:
        raise EvidenceError(f"`arguments` make no environment: {error}; {_RESTORE}") from None


def _label(record: EvidenceRecord, course: _Course | None, told: Any) -> Iterator[Finding]:
    """Whether the label follows from the outcome and the stored replays."""
    fields = record.fields
    expected = failure_label(facts_of(fields, course), replays_of(fields))
    recorded = fields["failure_label"]
    if recorded != expected.label:
        if course is not None or {recorded, expected.label} - set(_ALIKE):
            yield told("failure_label", recorded, expected.label)
        return
    if course is None and recorded in _ALIKE:
        return
    if fields["schema_version"] < CODED_REASONS:
        sentence = failure_sentence({**fields, **expected.columns()})
        if course is not None and fields["failure_reason"] != sentence:
            yield told("failure_reason", fields["failure_reason"], sentence)
        return
    if fields["failure_reason"] != expected.reason:
        yield told("failure_reason", fields["failure_reason"], expected.reason)
    numbers = parse_field("failure_numbers", fields["failure_numbers"])
    for name in sorted({*numbers, *expected.numbers}):
        if course is None and name in _OF_TRACE:
            continue
        if not same(numbers.get(name), expected.numbers.get(name), 1e-9):
            yield told(f"failure_numbers.{name}", numbers.get(name), expected.numbers.get(name))


def facts_of(fields: Any, course: _Course | None) -> EpisodeFacts:
    period = fields["control_period"]
    return EpisodeFacts(
        success=fields["success"],
        time=None if period is None else fields["length"] * period,
        episode_return=fields["return"],
        solver_status=fields["solver_status"],
        saturated_share=fields["saturated_share"],
        goal_reached=course.reached if course else None,
        goal_left=course.left if course else None,
        goal_since=course.since if course else None,
        observation_noise=fields["observation_noise"],
        staleness=_staleness(fields),
        homes=len(context_of(fields).homes),
    )


def _staleness(fields: Any) -> float:
    """Action latency plus the greatest age that a sample can have at a decision, s."""
    dt, substeps = fields["dt"], fields["substeps"]
    if dt is None:
        return 0.0
    sensor = round(fields["sensor_period"] / dt)
    age = dt * (sensor - gcd(sensor, substeps))
    return float(fields["action_latency"] + age)


def replays_of(fields: Any) -> Replays:
    """What the record says of its replays."""
    home = fields["replay_home"]
    return Replays(
        home=context_of(fields).home(fields) if home is None else home,
        without_noise=fields["replay_without_noise"],
        without_delay=fields["replay_without_delay"],
        second_horizon=fields["replay_second_horizon"],
        home_success=fields["home_success"],
        cell_status=fields["cell_status"],
    )


def context_of(fields: Any) -> EpisodeContext:
    """What a record's fields say of its episode's context.

    Of a policy without a training discretization only the reason tells whether that is known:
    where it is not, a replay at home would have to explain the failure.

    Raises:
        EvidenceError: for a damaged field.
    """
    unknown = fields["failure_label"] == "unattributed" and lacks_home(fields)
    name = "training_discretization"
    return EpisodeContext(
        run_id=fields["run_id"],
        cell=fields["cell"],
        phase=fields["phase"],
        policy_id=fields["policy_id"],
        policy_hash=fields["policy_hash"],
        training_discretization=parse_field(name, fields[name]),
        home_known=not unknown,
        training_seed=fields["training_seed"],
        perturbation=parse_field("perturbation", fields["perturbation"]),
        float_width=fields["float_width"],
    )


def _finite(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None
