"""The schema of a file of records: Arrow's with units as metadata, and the JSON Schema."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import NoneType
from typing import Any

from integ_gym.support.errors import IntegGymError
from integ_gym.support.files import Kinds, check_object, parse_json
from integ_gym.support.optional import load
from integ_gym.support.terminal import visible

from .fields import COMMON_TRACE, CONTACT_TRACE, SCHEMA_VERSION, SUMMARY_FIELDS, Field


class EvidenceError(IntegGymError, ValueError):
    """One sentence that says what is wrong with the evidence and what helps."""


class BatchExistsError(EvidenceError):
    """A batch of that name has already been committed."""


@dataclass(frozen=True)
class Finding:
    """One thing that is not as it should be.

    Attributes:
        file: where, relative to the run.
        record_id: the record, or None if more than one is meant.
        message: what is wrong.
    """

    file: str
    record_id: str | None
    message: str

    def __str__(self) -> str:
        where = self.file if self.record_id is None else f"{self.file}: {self.record_id}"
        return visible(f"{where}: {self.message}")


pyarrow = partial(load, "pyarrow", "evidence")
"""``pyarrow``; see :func:`integ_gym.support.optional.load`."""

compute = partial(load, "pyarrow.compute", "evidence")
"""``pyarrow.compute``."""

parquet = partial(load, "pyarrow.parquet", "evidence")
"""``pyarrow.parquet``."""

duckdb = partial(load, "duckdb", "evidence")
"""``duckdb``."""


VERSION_KEY = b"integ_gym.evidence.schema_version"
ENV_KEY = b"integ_gym.evidence.env_id"

_KEPT = ("unit", "frame", "meaning", "group", "at")
_SUMMARY_NAMES = frozenset(field.name for field in SUMMARY_FIELDS)


def arrow_type(kind: str) -> Any:
    """The Arrow type of a field's kind."""
    pa = pyarrow()
    if kind.startswith("list<"):
        return pa.list_(arrow_type(kind[5:-1]))
    if kind == "timestamp":
        return pa.timestamp("us", tz="UTC")
    return pa.type_for_alias("string" if kind == "json" else kind)


def arrow_field(field: Field) -> Any:
    """The Arrow field, with unit, frame, meaning, group and place in time as metadata."""
    metadata = {name: getattr(field, name) for name in _KEPT}
    kind = arrow_type(field.kind)
    return pyarrow().field(field.name, kind, nullable=field.nullable, metadata=metadata)


def arrow_schema(fields: Iterable[Field], env_id: str) -> Any:
    """Schema of a file of records of one environment."""
    return pyarrow().schema(
        [arrow_field(field) for field in fields],
        metadata={VERSION_KEY: str(SCHEMA_VERSION), ENV_KEY: env_id},
    )


def is_trace(name: str) -> bool:
    """Whether a column belongs to the trace."""
    return name not in _SUMMARY_NAMES


def described(field: Any) -> dict[str, str]:
    """Unit, frame, meaning, group and place in time of an Arrow field; empty where not stated."""
    metadata = field.metadata or {}
    return {name: metadata.get(name.encode(), b"").decode() for name in _KEPT}


_ARGUMENT: Kinds = {"value": (object, bool), "unit": str}

_FORMS: Mapping[str, tuple[type, ...]] = {
    "arguments": (dict,),
    "engine_description": (dict,),
    "failure_numbers": (dict,),
    "perturbation": (dict, NoneType),
    "training_discretization": (dict, list, NoneType),
}
"""What the texts of JSON fields hold; a list holds objects."""


def parse_field(name: str, text: str | None) -> Any:
    """What the text of a JSON field of that name says; None of null.

    Raises:
        EvidenceError: if it is not of the field's form, in one sentence.
    """
    try:
        value = parse_json((text or "null").encode())
    except (AttributeError, ValueError) as error:
        raise _damage_error(name, f"it is no JSON ({error})") from None
    members = value if isinstance(value, list) else []
    forms = _FORMS.get(name, (object,))
    if not isinstance(value, forms) or not all(isinstance(member, dict) for member in members):
        raise _damage_error(
            name, "it is no object" if len(forms) < 3 else "it is no object or list"
        )
    return value


def parse_arguments(text: str) -> dict[str, dict[str, Any]]:
    """Value and unit of a record's constructor arguments and plant parameters, by name.

    Raises:
        EvidenceError: if the field is not of that form, in one sentence.
    """
    arguments = parse_field("arguments", text)
    try:
        return {name: check_object(one, _ARGUMENT) for name, one in arguments.items()}
    except ValueError:
        raise _damage_error("arguments", "it is no object of values with units") from None


def argument_values(text: str) -> dict[str, Any]:
    """The same without units."""
    return {name: argument["value"] for name, argument in parse_arguments(text).items()}


def _damage_error(name: str, fault: str) -> EvidenceError:
    return EvidenceError(f"`{name}` is damaged: {fault}; restore the file from a copy")


SCHEMA_PATH = Path(__file__).with_name("evidence_record.schema.json")

_TYPES = {
    "string": {"type": "string"},
    "json": {"type": "string", "contentMediaType": "application/json"},
    "bool": {"type": "boolean"},
    "int8": {"type": "integer"},
    "int32": {"type": "integer"},
    "int64": {"type": "integer"},
    "float32": {"type": "number"},
    "float64": {"type": "number"},
    "timestamp": {"type": "string", "format": "date-time"},
}

_PATTERNS = {
    "^sensed_": "observation as the policy was given it",
    "_commanded$": "control asked for by the decision, N or N m",
    "_applied$": "control in force at the end of the control step, N or N m",
    "_penetration$": "deepest penetration of a contact point, m",
    "_(normal|tangential)_force$": "force on a contact point or foot, N",
    "_slip_speed$": "slip of a contact point or foot, m/s",
    "^slip_loss$": "energy that friction took at contact points, J",
}


def schema_head(title: str) -> dict[str, str]:
    """How a published JSON Schema begins."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": title}


def json_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of one record of any environment.

    A trace column may be left out, for a summary; true state components go by the plant's own
    names, so that any further property must be a list of numbers.
    """
    return {
        **schema_head(f"EvidenceRecord, version {SCHEMA_VERSION}"),
        "type": "object",
        "required": [field.name for field in SUMMARY_FIELDS],
        "properties": {f.name: _property(f) for f in (*SUMMARY_FIELDS, *COMMON_TRACE)}
        | {f.name: _property(f) for f in CONTACT_TRACE},
        "patternProperties": {
            pattern: _numbers("float64") | {"description": meaning}
            for pattern, meaning in _PATTERNS.items()
        },
        "additionalProperties": _numbers("float64")
        | {"description": "true state component, by the plant's own name"},
    }


def published_text(schema: Mapping[str, Any]) -> str:
    """The content of a published JSON Schema."""
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def schema_text() -> str:
    """The content of the published file."""
    return published_text(json_schema())


def _property(field: Field) -> dict[str, Any]:
    described = _kind(field) | {"description": field.meaning}
    if field.unit:
        described["x-unit"] = field.unit
    if field.volatile:
        described["x-volatile"] = True
    return described


def _kind(field: Field) -> dict[str, Any]:
    if field.name == "schema_version":
        return {"enum": [*range(1, SCHEMA_VERSION + 1)]}
    if field.choices:
        return {"enum": [*field.choices, *([None] if field.nullable else [])]}
    if field.kind.startswith("list<"):
        kind = _numbers(field.kind[5:-1])
        return kind if field.nullable else kind | {"type": "array"}
    kind = dict(_TYPES[field.kind])
    return kind | {"type": [kind["type"], "null"]} if field.nullable else kind


def _numbers(kind: str) -> dict[str, Any]:
    """A list of numbers, null without a trace, whose last entry is null in a step column."""
    return {"type": ["array", "null"], "items": {"type": [_TYPES[kind]["type"], "null"]}}


def write_schema() -> None:
    """Write the published file."""
    SCHEMA_PATH.write_text(schema_text(), encoding="utf-8")
