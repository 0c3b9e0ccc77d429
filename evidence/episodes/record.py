"""One episode's evidence, read back."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.support.files import Kinds, checked_object, parse_json

from ..schema.arrow import described, is_trace
from ..schema.errors import EvidenceError
from ..schema.extra import pyarrow
from ..schema.fields import SUMMARY_FIELDS

Array = npt.NDArray[Any]

_ARGUMENT: Kinds = {"value": (object, bool), "unit": str}


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
            name: _padded(self.trace[name], rows) if name in self.trace else None
            for name in self.units
            if is_trace(name)
        }
        return json.dumps(self.summary() | trace, ensure_ascii=False, allow_nan=False)


def argument_values(text: str) -> dict[str, Any]:
    """Constructor arguments and plant parameters of a record's field, without their units.

    Raises:
        EvidenceError: if it is not of that form, in one sentence.
    """
    told = told_arguments(text)
    return {name: argument["value"] for name, argument in told.items()}


def told_arguments(text: str) -> dict[str, dict[str, Any]]:
    """Value and unit of constructor arguments and plant parameters, by name.

    Raises:
        EvidenceError: if the field is not of that form, in one sentence.
    """
    told = told_json("arguments", text)
    try:
        return {name: checked_object(one, _ARGUMENT) for name, one in told.items()}
    except (AttributeError, ValueError):
        raise _damaged("arguments", "it is no object of values with units") from None


def told_training(fields: Mapping[str, Any]) -> dict[str, Any] | list[dict[str, Any]] | None:
    """What the policy of a record with these fields was trained on, a list for a mixture.

    Raises:
        EvidenceError: if the field is not of that form, in one sentence.
    """
    told = told_json("training_discretization", fields["training_discretization"] or "null")
    members = told if isinstance(told, list) else [told or {}]
    if not all(isinstance(member, dict) for member in members):
        raise _damaged("training_discretization", "it is no discretization and no list of some")
    return told  # type: ignore[no-any-return]


def told_perturbation(fields: Mapping[str, Any]) -> dict[str, Any] | None:
    """Plant parameters that are changed in a record with these fields; None without any.

    Raises:
        EvidenceError: if the field is not of that form, in one sentence.
    """
    told = told_json("perturbation", fields["perturbation"] or "null")
    if told is None or isinstance(told, dict):
        return told
    raise _damaged("perturbation", "it is no object of arguments")


def told_engine(text: str) -> dict[str, Any]:
    """What a record's field `engine_description` says.

    Raises:
        EvidenceError: if it is not of that form, in one sentence.
    """
    told = told_json("engine_description", text)
    if isinstance(told, dict):
        return told
    raise _damaged("engine_description", "it is no object")


def told_json(name: str, text: Any) -> Any:
    """What a field of that name says, whose text holds JSON.

    Raises:
        EvidenceError: if it holds none, in one sentence.
    """
    try:
        return parse_json(text.encode())
    except (AttributeError, ValueError) as error:
        raise _damaged(name, f"it is no JSON ({error})") from None


def _damaged(name: str, fault: str) -> EvidenceError:
    return EvidenceError(f"`{name}` is damaged: {fault}; restore the file from a copy")


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
    return [None if x.values is None else _numbers(x.values[:end]) for x in array or ()]


def _numbers(values: Any) -> Array:
    numbers: Array = values.to_numpy(zero_copy_only=False)
    return numbers


def _padded(values: Array, rows: int) -> list[Any]:
    return [*plain(values.tolist()), *[None] * (rows - len(values))]


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
