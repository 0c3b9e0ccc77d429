"""One episode's record, made of its log and of what is known of the run."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np

from integ_gym.envs.ops.ops import Array

from .fields import SUMMARY_FIELDS
from .labels import failure_sentence
from .schema import argument_values, described, is_trace, pyarrow


@dataclass(frozen=True)
class EvidenceRecord:
    """One episode.

    Attributes:
        fields: all fields but the trace, by name.
        trace: trace columns by name, without those that are null; a column of control instants
            has ``length`` + 1 values, one of control steps ``length``; NaN where one is not known.
        units: unit of every column of the file.
        frames: reference frame of every column of the file, empty where none applies.
    """

    fields: Mapping[str, Any]
    trace: Mapping[str, Array]
    units: Mapping[str, str]
    frames: Mapping[str, str]

    def __getitem__(self, name: str) -> Any:
        """A field's value or a trace column."""
        return self.trace[name] if name in self.trace else self.fields[name]

    def arguments(self) -> dict[str, Any]:
        """Constructor arguments and plant parameters, without their units."""
        return argument_values(self.fields["arguments"])

    @property
    def reason(self) -> str:
        """Why the episode ended as it did, in a sentence with numbers."""
        return failure_sentence(self.fields)

    @property
    def first_of_seed(self) -> bool:
        """Whether its seed gives all that was drawn: it is the first episode of that seed."""
        return self.fields["seed"] is not None and self.fields["rng_key"].endswith("/0")

    def summary(self) -> dict[str, Any]:
        """All fields but the trace, fit for JSON."""
        return {name: plain(value) for name, value in self.fields.items()}

    def to_json(self) -> str:
        """The record as JSON, after the published JSON Schema."""
        rows = int(self.fields["length"]) + 1
        trace: dict[str, Any] = {
            name: [*plain(found), *[None] * (rows - len(found))] if found is not None else None
            for name, found in ((n, self.trace.get(n)) for n in self.units if is_trace(n))
        }
        return json.dumps(self.summary() | trace, ensure_ascii=False, allow_nan=False)


def records_of(table: Any) -> list[EvidenceRecord]:
    """The records of an Arrow table with the columns of one file."""
    about = {field.name: described(field) for field in table.schema}
    units = {name: about[name]["unit"] for name in about}
    frames = {name: about[name]["frame"] for name in about}
    trace_names = [name for name in table.column_names if is_trace(name)]
    names = [name for name in table.column_names if not is_trace(name)]
    traces = {name: _arrays(table.column(name), about[name]["at"]) for name in trace_names}
    absent = {f.name: None for f in SUMMARY_FIELDS if f.since > 1 and f.name not in names}
    records = []
    for i, row in enumerate(table.select(names).to_pylist()):
        trace = {name: arrays[i] for name, arrays in traces.items()}
        present = {name: array for name, array in trace.items() if array is not None}
        records.append(EvidenceRecord(row | absent, present, units, frames))
    return records


def _arrays(column: Any, at: str) -> list[Array | None]:
    """The values of every list of a column, NaN where there is none; None for a null list.

    The last value of a column of control steps stands for no step.
    """
    array = pyarrow().concat_arrays(column.chunks) if column.num_chunks else None
    end = -1 if at == "step" else None
    lists = (x.values for x in array or ())
    return [None if x is None else x[:end].to_numpy(zero_copy_only=False) for x in lists]


def plain(value: Any, digits: int | None = None) -> Any:
    """A value fit for JSON: times as ISO 8601, what is not finite as null.

    Args:
        value: nested lists, tuples, dicts and arrays of such values.
        digits: significant digits that are kept of floats; None: all.
    """
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, float):
        if not math.isfinite(value):
            return None
        return value if digits is None else float(f"{value:.{digits}g}")
    if isinstance(value, (list, tuple)):
        return [plain(x, digits) for x in value]
    if isinstance(value, dict):
        return {key: plain(x, digits) for key, x in value.items()}
    return plain(value.tolist(), digits) if isinstance(value, np.ndarray) else value
