"""Recorded values held against computed ones."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from .fields import CODED_REASONS, SUMMARY_FIELDS, VOLATILE_NAMES
from .record import EvidenceRecord
from .schema import Finding, parse_field


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
