"""Outcomes, ledger and label of a record, recomputed from its own trace and stored replays."""

from __future__ import annotations

import math
import re
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

from .episodes import told_setup
from .fields import CODED_REASONS, FIRST_WRITTEN, SUMMARY_FIELDS, VOLATILE_NAMES
from .labels import (
    EpisodeContext,
    EpisodeFacts,
    Replays,
    failure_label,
    failure_sentence,
    lacks_home,
)
from .record import EvidenceRecord
from .schema import (
    EvidenceError,
    Finding,
    argument_values,
    parse_field,
)


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


def is_number(value: Any) -> bool:
    """Whether a value is a number, which a flag is not."""
    return isinstance(value, int | float) and not isinstance(value, bool)


Array = npt.NDArray[Any]


GROWTH = 10.0
"""How many times what a nudged start changes may be put down to rounding."""


_NOT_REPLAYED = VOLATILE_NAMES | {
    *("seed", "rng_key", "failure_reason", "failure_numbers"),
    *("record_id", "run_id", "schema_version", "package_versions", "trace_every"),
}
"""Fields that say how starts came about, or that a replay is told."""


_OF_ACTIONS = frozenset(("saturated_share", "fallback_count", "recovery_count"))
"""Fields that say how controls came about. A control that is repeated tells them too, unless it may
have been the fallback's."""


_ITERATIONS = "solver_iterations"


_NUMBER = re.compile(r"[-+]?\d[\d.,e]*")
"""A number in a sentence, which rounding changes."""


OWN_NOISE = 4
"""Schema version since which an episode's noise is drawn apart from starts, and can be again."""


def noise_source(record: EvidenceRecord) -> tuple[int, int] | None:
    """Seed and episode that give a record's sensor noise again; None: it cannot be."""
    entropy, _, episode = str(record.fields["rng_key"]).rpartition("/")
    known = entropy.isdecimal() and episode.isdecimal()
    if not known or record.fields["schema_version"] < OWN_NOISE:
        return None
    return int(entropy), int(episode)


def drawn_again(record: EvidenceRecord) -> bool:
    """Whether its seed gives its start; lanes of a training may have drawn a discretization too."""
    return record.first_of_seed and record.fields["phase"] != "training"


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
    decided_here = decided or not _may_have_fallen_back(record)
    left_out = _NOT_REPLAYED if decided_here else _NOT_REPLAYED | _OF_ACTIONS
    for own in SUMMARY_FIELDS:
        if own.name in left_out or own.since > fields["schema_version"]:
            continue
        recorded, computed = fields[own.name], again.fields[own.name]
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
    numbers = [
        parse_field("failure_numbers", one.fields["failure_numbers"])
        for one in (record, again, nudged)
    ]
    for name in sorted({*numbers[0], *numbers[1]}):
        recorded, computed, moved = (own.get(name) for own in numbers)
        if not _alike(recorded, computed, moved, tolerance, 0.0):
            yield f"failure_numbers.{name}", recorded, computed


def _may_have_fallen_back(record: EvidenceRecord) -> bool:
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
