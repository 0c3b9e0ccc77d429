"""Outcomes, ledger and label of a record, recomputed from its own trace and stored replays."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from functools import lru_cache
from math import gcd
from typing import Any, NamedTuple

import numpy as np

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.ops.ops import ARRAY, Array, split_state
from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.envs.settings import NATIVE
from integ_gym.envs.transition import STATUS_NAMES
from integ_gym.support.optional import installed_versions
from integ_gym.support.parameters import is_number

from . import labels
from .episodes import COMMANDED, MEASURED, native_setup
from .fields import (
    CODED_REASONS,
    FIRST_WRITTEN,
    SCHEMA_VERSION,
    SUMMARY_FIELDS,
    VOLATILE_NAMES,
    json_text,
)
from .record import EvidenceRecord
from .schema import EvidenceError, Finding, argument_values, parse_field


def deviation(file: str, record_id: str, field: str, recorded: Any, computed: Any) -> Finding:
    """That a record's field is not what it was computed to be."""
    message = f"`{field}` is recorded as {recorded!r}, and comes out as {computed!r}"
    return Finding(file, record_id, message)


def same(recorded: Any, computed: Any, tolerance: float, scale: float = 0.0) -> bool:
    """Whether two values agree.

    Args:
        recorded: a number, or anything else, which must be equal.
        computed: the same.
        tolerance: of numbers, relative to the larger of 1, themselves and ``scale``.
        scale: what a number was added up from.
    """
    if not (is_number(recorded) and is_number(computed)):
        return bool(recorded == computed)
    if math.isnan(recorded) or math.isnan(computed):
        return math.isnan(recorded) and math.isnan(computed)
    if recorded == computed:
        return True
    largest = max(1.0, abs(recorded), abs(computed), scale)
    return bool(abs(recorded - computed) <= tolerance * largest)


GROWTH = 10.0
"""How many times what a nudged start changes may be put down to rounding."""


_NOT_REPLAYED = VOLATILE_NAMES | {
    *("seed", "rng_key", "failure_reason", "failure_numbers"),
    *("record_id", "run_id", "schema_version", "package_versions", "trace_every"),
}
"""Fields that say how starts came about, or that a replay is given."""


_OF_ACTIONS = frozenset(("saturated_share", "fallback_count", "recovery_count"))
"""Fields that say how controls came about. A control that is repeated tells them too, unless it may
have been the fallback's."""


_ITERATIONS = "solver_iterations"


_NUMBER = re.compile(r"[-+]?\d[\d.,e]*")
"""A number in a sentence, which rounding changes."""


OWN_NOISE = 4
"""Schema version since which an episode's noise is drawn apart from starts, and can be again."""


def noise_source(record: EvidenceRecord) -> tuple[int, int] | None:
    """Seed and episode that give what is drawn in an episode again; None: it cannot be."""
    entropy, _, episode = str(record.fields["rng_key"]).rpartition("/")
    known = entropy.isdecimal() and episode.isdecimal()
    if not known or record.fields["schema_version"] < OWN_NOISE:
        return None
    return int(entropy), int(episode)


def start_follows_seed(record: EvidenceRecord) -> bool:
    """Whether its seed gives its start; lanes of a training may have drawn a discretization too."""
    return record.first_of_seed and record.fields["phase"] != "training"


def _of_those_told(name: str, text: str, recorded: str) -> str:
    """A field of JSON without the entries that a record of an earlier version did not have yet."""
    known, every = (parse_field(name, own) for own in (recorded, text))
    return json_text({name: value for name, value in every.items() if name in known})


def differences(
    record: EvidenceRecord,
    again: EvidenceRecord,
    tolerance: float,
    decided: bool,
    nudged: EvidenceRecord | None = None,
) -> Iterator[tuple[str, Any, Any]]:
    """Field or place in the trace, recorded and computed value.

    Args:
        record: as it was recorded.
        again: the same episode played again.
        tolerance: relative; one iteration of the solver more or less is let pass where it is not 0.
        decided: whether the policy decided again.
        nudged: the same from a start that is another by a little; differences up to `GROWTH` times
            those that this makes are let pass.
    """
    fields = record.fields
    decided_here = decided or not may_have_fallen_back(record)
    left_out = _NOT_REPLAYED if decided_here else _NOT_REPLAYED | _OF_ACTIONS
    if fields["engine"] == NATIVE:
        left_out = left_out | {"engine_version"}  # integ-gym's own, which follows from the record
    is_older = fields["schema_version"] < SCHEMA_VERSION
    for own in SUMMARY_FIELDS:
        if own.name in left_out or own.since > fields["schema_version"]:
            continue
        recorded, computed = fields[own.name], again.fields[own.name]
        if own.name in ("arguments", "engine_description") and is_older:
            computed = _of_those_told(own.name, computed, recorded)
        moved = computed if nudged is None else nudged.fields[own.name]
        slack = 1.0 if tolerance and own.name.startswith(_ITERATIONS) else 0.0
        if not _alike(recorded, computed, moved, tolerance, slack):
            yield own.name, recorded, computed
    if decided:
        yield from _other_reason(record, again, nudged or again, tolerance)
    for column in {**record.trace, **again.trace} if record.trace else ():
        noisy = column.startswith("sensed_") and fields["observation_noise"]
        if noisy and noise_source(record) is None:
            continue
        values, other = record.trace.get(column), again.trace.get(column)
        if values is None and is_older:
            continue
        if values is None:
            yield column, None, f"{len(again.trace[column])} values"
            continue
        moved = other if nudged is None else nudged.trace.get(column)
        if other is None or other.shape != values.shape:
            if moved is None or other is None or moved.shape == other.shape:
                yield f"len({column})", len(values), None if other is None else len(other)
            continue
        slack = 1.0 if tolerance and column == _ITERATIONS else 0.0
        place = _first_difference(values, other, moved, tolerance, slack)
        if place is not None:
            yield f"{column}[{place}]", values[place].item(), other[place].item()


def _other_reason(
    record: EvidenceRecord, again: EvidenceRecord, nudged: EvidenceRecord, tolerance: float
) -> Iterator[tuple[str, Any, Any]]:
    """What of the reasons differs; controls that are repeated saturate nothing."""
    if record.fields["schema_version"] < CODED_REASONS:
        sentences = [_NUMBER.sub("#", one.reason) for one in (record, again, nudged)]
        if sentences[0] != sentences[1] == sentences[2]:
            yield "failure_reason", record.reason, again.reason
        return
    codes = [one.fields["failure_reason"] for one in (record, again, nudged)]
    if codes[0] != codes[1]:
        if codes[1] == codes[2]:
            yield "failure_reason", *codes[:2]
        return
    every = (record, again, nudged)
    numbers = [parse_field("failure_numbers", one.fields["failure_numbers"]) for one in every]
    for name in sorted({*numbers[0], *numbers[1]}):
        recorded, computed, moved = (own.get(name) for own in numbers)
        if not _alike(recorded, computed, moved, tolerance, 0.0):
            yield f"failure_numbers.{name}", recorded, computed


def may_have_fallen_back(record: EvidenceRecord) -> bool:
    """Whether some control is what the fallback gives where a decision was no number."""
    for column, asked in record.trace.items():
        if column.endswith("_commanded"):
            before = np.append(0.0, asked[:-1]) if record["fallback"] == "hold" else 0.0
            return bool(np.any(asked == before))
    return True


def _alike(recorded: Any, computed: Any, moved: Any, tolerance: float, slack: float) -> bool:
    if isinstance(recorded, list) and isinstance(computed, list):
        pairs = zip(recorded, computed, strict=False)
        return len(recorded) == len(computed) and all(same(a, b, tolerance) for a, b in pairs)
    if same(recorded, computed, tolerance):
        return True
    numbers = [x for x in (recorded, computed, moved) if is_number(x)]
    if len(numbers) < 3:  # rounding decides which it is, but makes no number a null
        return not (is_number(computed) and is_number(moved)) and bool(computed != moved)
    return bool(abs(recorded - computed) <= slack + GROWTH * abs(moved - computed))


def _first_difference(
    values: Array, again: Array, moved: Array | None, tolerance: float, slack: float
) -> int | None:
    """Place of the first value that differs; None if none does."""
    one, other = values.astype(np.float64), again.astype(np.float64)
    grown = np.zeros(len(other))
    if moved is not None and moved.shape == again.shape:
        grown = np.fmax.accumulate(np.abs(moved.astype(np.float64) - other))
    limit = slack + tolerance * np.maximum(1.0, np.abs(one)) + GROWTH * np.nan_to_num(grown)
    gone = np.isnan(one) & np.isnan(other)
    differs = ~((one == other) | (np.abs(one - other) <= limit) | gone)
    places = np.flatnonzero(differs)
    return int(places[0]) if places.size else None


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

_RESTORE = "restore the file from a copy"

UNFIT = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError)
"""What values of another type end in."""

_ALIKE = ("control_error", "planning_error")
"""Labels that only a trace tells apart."""

_OF_TRACE = ("reached", "left", "since")
"""Numbers of reasons that only a trace gives."""

Deviations = Iterator[tuple[str, Any, Any]]
"""Field or place in the trace, recorded and computed value."""


def recompute(record: EvidenceRecord, file: str) -> Iterator[Finding]:
    """What of a record is not what its trace and its replays make of it.

    Without a trace, only its length and what the label rests on are checked.

    Args:
        record: with its trace, if it has one.
        file: that it is in.
    """
    name = str(record.fields["record_id"])
    try:
        yield from [deviation(file, name, *one) for one in _find_deviations(record)]
    except EvidenceError as error:
        yield Finding(file, name, str(error))
    except UNFIT as error:
        message = f"cannot be recomputed ({error}): its values are not of this schema; {_RESTORE}"
        yield Finding(file, name, message)


def _find_deviations(record: EvidenceRecord) -> Deviations:
    fields, trace, course = record.fields, record.trace, None
    yield from _differ(fields, _derive_fields(fields), 1e-12)
    yield from _check_ledger(fields)
    yield from _check_counts(fields)
    every, index = fields["trace_every"], fields["episode_index"]
    if bool(trace) != (index % every == 0):
        fault = "it has a trace" if trace else "its trace is gone"
        raise EvidenceError(f"{fault}, at episode {index} with `trace_every` {every}; {_RESTORE}")
    if trace:
        length = len(trace["reward"])
        if fields["length"] != length:
            yield "length", fields["length"], length
            return
        for name, values in trace.items():
            if len(values) - length not in (0, 1):
                raise EvidenceError(
                    f"`{name}` has {len(values)} values in an episode of {length} control steps; "
                    f"{_RESTORE}"
                )
        tolerance = TOLERANCE.get(fields["float_width"], TOLERANCE[32])
        for name, computed, scale in _add_up(record):
            if not same(fields[name], computed, tolerance, scale):
                yield name, fields[name], computed
        course = course_of(record)
        if course is not None:
            names = ("success", "terminated", "truncated")
            outcome = {name: getattr(course, name) for name in names}
            outcome["time_to_success"] = course.since if course.success else None
            yield from _differ(fields, outcome)
    elif fields["env_id"] in ENVIRONMENTS:
        horizon = _find_setup(fields).timing.horizon
        if fields["success"] is None:
            yield "success", None, "true or false"
        if fields["length"] > horizon:
            yield "length", fields["length"], horizon
        yield from _differ(fields, {"truncated": fields["length"] >= horizon})
    if fields["schema_version"] > 1:  # which did not keep what its labels rest on
        yield from _check_label(record, course)


def _differ(fields: Any, expected: Mapping[str, Any], tolerance: float = 1e-9) -> Deviations:
    for name, wanted in expected.items():
        if name in fields and not same(fields[name], wanted, tolerance):
            yield name, fields[name], wanted


def _derive_fields(fields: Any) -> dict[str, Any]:
    """Fields that follow from others of the same record."""
    expected: dict[str, Any] = {"metric": "success"}
    expected["record_id"] = context_of(fields).record_id(fields["episode_index"])
    if fields["phase"] == "training":
        expected |= {"policy_hash": "", "perturbation": None, **labels.Replays().columns()}
    if not fields["success"]:
        expected["time_to_success"] = None
    if fields.get("arrival_time") is None:
        expected |= {"arrival_energy": None, "arrival_residual": None}
    versions = parse_field("package_versions", fields["package_versions"])
    if not isinstance(versions, dict):
        return expected
    if fields["env_id"] in ENVIRONMENTS:
        expected["command_error"] = None
    if fields["engine"] == NATIVE:
        expected["engine_version"] = versions.get("integ-gym")
    present = installed_versions(["integ-gym"]).items()
    if not versions.items() >= present or fields["env_id"] not in ENVIRONMENTS:
        return expected
    given = argument_values(fields["arguments"])
    if given.get("engine", NATIVE) != NATIVE or any(":" in str(x) for x in given.values()):
        return expected
    columns = _setup_columns(fields["env_id"], fields["arguments"])
    narrow = fields["float_width"] != 64
    own = {k: x for k, x in columns.items() if not (narrow and k == "engine_description")}
    if fields["schema_version"] < SCHEMA_VERSION:
        own["arguments"] = _of_those_told("arguments", own["arguments"], fields["arguments"])
    return expected | own


@lru_cache(maxsize=256)
def _setup_columns(env_id: str, arguments: str) -> dict[str, Any]:
    """Fields that follow from the constructor arguments of one of our own environments."""
    try:
        setup = environment_setup(env_id, argument_values(arguments))
    except (TypeError, ValueError) as error:
        raise EvidenceError(f"`arguments` make no environment: {error}; {_RESTORE}") from None
    return {
        field.name: field.origin.value(setup, 0)
        for field in SUMMARY_FIELDS
        if field.origin and field.origin.of == "setup"
    }


def _check_ledger(fields: Any) -> Deviations:
    """Energy at the end: that at the start, work and losses in between, and numerical error.

    Our own engine reports every entry while the motion is finite.
    """
    if fields["env_id"] not in ENVIRONMENTS:
        return
    parts = ("energy_start", "work_total", "energy_residual_total")
    own = fields["engine"] == NATIVE and fields["schema_version"] >= FIRST_WRITTEN
    if own and fields["solver_status"] != "diverged":
        names = (*parts, "energy_end", *_LOSSES)
        yield from ((name, None, "a number") for name in names if fields[name] is None)
    known = [fields[name] for name in parts]
    if None in (*known, fields["energy_end"]):
        return
    lost = [fields[name] or 0.0 for name in _LOSSES]
    tolerance = _LEDGER_TOLERANCE.get(fields["float_width"], _LEDGER_TOLERANCE[32])
    computed = sum(known) - sum(lost)
    if not same(fields["energy_end"], computed, tolerance, sum(map(abs, (*known, *lost)))):
        yield "energy_end", fields["energy_end"], computed
    absolute, least = fields["energy_residual_abs_total"], abs(fields["energy_residual_total"])
    if absolute is None or absolute < least * (1.0 - tolerance):
        yield "energy_residual_abs_total", absolute, least


def _check_counts(fields: Any) -> Deviations:
    """Of the fallback both counts are there, or where an environment tells none, neither is."""
    fell, rose = fields["fallback_count"], fields["recovery_count"]
    if fell is None and fields["env_id"] in ENVIRONMENTS:
        yield "fallback_count", None, "a number"
    elif (fell is None) != (rose is None):
        yield "recovery_count", rose, "null" if fell is None else "a number"
    elif fell is not None and not 0 <= rose <= min(fell, fields["length"] - fell):
        yield "recovery_count", rose, f"at most {min(fell, fields['length'] - fell)}"


def _add_up(record: EvidenceRecord) -> Iterator[tuple[str, Any, float]]:
    """Field, what the trace makes of it, and what it was added up from."""
    trace = record.trace
    for name, column in _SUMS.items():
        if column in trace:
            scale = float(np.abs(trace[column]).sum())
            yield name, _finite(trace[column].sum()), scale if math.isfinite(scale) else 0.0
    if "energy_residual" in trace:
        size = _finite(np.abs(trace["energy_residual"]).sum())
        yield "energy_residual_abs_total", size, size or 0.0
    for column in ("penetration", "constraint_violation"):
        if column in trace:
            yield f"{column}_max", _finite(trace[column].max(initial=0.0)), 0.0
    if "energy" in trace:
        yield "energy_start", float(trace["energy"][0]), 0.0
        yield "energy_end", float(trace["energy"][-1]), 0.0
    if "command_error" in record.fields:
        yield "command_error", _command_error(trace), 0.0
    if "solver_iterations" in trace:
        yield "solver_iterations_max", _finite(trace["solver_iterations"].max()), 0.0
        yield "solver_iterations_mean", _finite(trace["solver_iterations"].mean()), 0.0
    yield "solver_status", STATUS_NAMES[int(trace["solver_status_code"].max())], 0.0
    if "time" in trace:
        yield "initial_state", [float(x[0]) for x in _states(record)], 0.0


def _command_error(trace: Mapping[str, Array]) -> float | None:
    """Root mean square of what is commanded minus what is measured, where a trace tells it."""
    names = [name.removeprefix(MEASURED) for name in trace if name.startswith(MEASURED)]
    missed = [trace[COMMANDED + name] - trace[MEASURED + name] for name in names]
    return float(np.sqrt(np.mean(np.sum(np.square(missed), axis=0)))) if missed else None


def _finite(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None


def _states(record: EvidenceRecord) -> list[Array]:
    """The true state's columns, in state order: they come right after the time."""
    names = list(record.trace)
    first = names.index("time") + 1
    return [record.trace[name] for name in names[first : first + len(record["initial_state"])]]


class Course(NamedTuple):
    """What the rules of success and labels look at, in s; None where it never was."""

    reached: float | None
    left: float | None
    since: float | None
    success: bool
    terminated: bool
    truncated: bool


def course_of(record: EvidenceRecord) -> Course | None:
    """The way to the goal; None where the task is not one of ours."""
    fields = record.fields
    if fields["env_id"] not in ENVIRONMENTS:
        return None
    setup = _find_setup(fields)
    q, v = split_state(tuple(_states(record)))
    time = record.trace["time"]
    there = np.broadcast_to(np.asarray(setup.task.at_goal(ARRAY, q, v)), time.shape)
    arrived, left = np.flatnonzero(there), np.flatnonzero(there[:-1] & ~there[1:]) + 1
    away = np.flatnonzero(~there)
    since = None
    if there[-1]:
        since = float(time[away[-1] + 1]) if away.size else float(time[0])
    over = setup.task.terminated(ARRAY, tuple(x[-1:] for x in q), tuple(x[-1:] for x in v))
    ended, diverged = bool(np.any(over)), fields["solver_status"] == "diverged"
    terminated = ended or diverged
    truncated = fields["length"] >= setup.timing.horizon
    if getattr(setup.task, "ends_at_goal", False):
        lasted = ended and not diverged
    else:
        lasted = truncated and not terminated
    stayed = since is not None and time[-1] - since >= setup.task.goal_stay * (1.0 - 1e-4)
    return Course(
        reached=float(time[arrived[0]]) if arrived.size else None,
        left=float(time[left[-1]]) if left.size else None,
        since=since,
        success=lasted and stayed,
        terminated=terminated,
        truncated=truncated,
    )


def _find_setup(fields: Any) -> Any:
    """The setup of one of our environments, with its goal and times.

    Raises:
        EvidenceError: where there is none with the record's arguments.
    """
    try:
        return native_setup(fields["env_id"], fields["arguments"])
    except EvidenceError:
        raise
    except (TypeError, ValueError) as error:
        raise EvidenceError(f"`arguments` make no environment: {error}; {_RESTORE}") from None


def _check_label(record: EvidenceRecord, course: Course | None) -> Deviations:
    """Whether the label follows from the outcome and the stored replays."""
    fields = record.fields
    expected, recorded = failure_of(fields, course), fields["failure_label"]
    if recorded != expected.label:
        if course is not None or {recorded, expected.label} - set(_ALIKE):
            yield "failure_label", recorded, expected.label
    elif course is None and recorded in _ALIKE:
        return
    elif fields["schema_version"] < CODED_REASONS:
        sentence = labels.failure_sentence({**fields, **expected.columns()})
        if course is not None:
            yield from _differ(fields, {"failure_reason": sentence})
    else:
        yield from _differ(fields, {"failure_reason": expected.reason})
        numbers = parse_field("failure_numbers", fields["failure_numbers"])
        for name in sorted({*numbers, *expected.numbers}):
            values = numbers.get(name), expected.numbers.get(name)
            if not (course is None and name in _OF_TRACE) and not same(*values, 1e-9):
                yield f"failure_numbers.{name}", *values


def failure_of(fields: Any, course: Course | None) -> labels.Failure:
    """Label and reason that follow from a record's fields and its way to the goal."""
    dt, period = fields["dt"], fields["control_period"]
    staleness = 0.0
    if dt is not None:
        sensor = round(fields["sensor_period"] / dt)
        oldest_sample = dt * (sensor - gcd(sensor, fields["substeps"]))
        values = argument_values(fields["arguments"])
        further = sum(values.get(name, 0.0) for name in ("observation_latency", "latency_jitter"))
        further += period if values.get("hold_probability") else 0.0
        staleness = fields["action_latency"] + further + oldest_sample
    facts = labels.EpisodeFacts(
        success=fields["success"],
        time=None if period is None else fields["length"] * period,
        episode_return=fields["return"],
        solver_status=fields["solver_status"],
        saturated_share=fields["saturated_share"],
        goal_reached=course.reached if course else None,
        goal_left=course.left if course else None,
        goal_since=course.since if course else None,
        observation_noise=fields["observation_noise"],
        staleness=float(staleness),
        homes=len(context_of(fields).homes),
    )
    return labels.failure_label(facts, replays_of(fields))


def replays_of(fields: Any) -> labels.Replays:
    """What the record says of its replays."""
    said = {name: fields[column] for name, column in labels.REPLAY_COLUMNS.items()}
    if said["home"] is None:
        said["home"] = context_of(fields).home(fields)
    return labels.Replays(**said)


def context_of(fields: Any) -> labels.EpisodeContext:
    """What a record's fields say of its episode's context.

    Of a policy without a training discretization only the reason tells whether that is known:
    where it is not, a replay at home would have to explain the failure.

    Raises:
        EvidenceError: for a damaged field.
    """
    known = {name: fields[name] for name in _OF_CONTEXT}
    for name in ("training_discretization", "perturbation"):
        known[name] = parse_field(name, fields[name])
    unknown = fields["failure_label"] == "unattributed" and labels.lacks_home(fields)
    return labels.EpisodeContext(**known, home_known=not unknown)


_OF_CONTEXT = (
    *("run_id", "cell", "phase", "policy_id", "policy_hash", "training_seed", "float_width"),
)
"""Fields that say what they say of the context."""
