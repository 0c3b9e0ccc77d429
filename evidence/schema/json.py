"""The published JSON Schema of a record, as JSON lines and :meth:`EvidenceRecord.to_json` give it.

After a change of the fields, :func:`write_schema` brings the published file up to date.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from .fields import SCHEMA_VERSION, SUMMARY_FIELDS, Field
from .trace_fields import COMMON_TRACE, CONTACT_TRACE

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
}


def json_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of one record of any environment.

    A trace column may be left out, for a summary; true state components go by the plant's own
    names, so that any further property must be a list of numbers.
    """
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"EvidenceRecord, version {SCHEMA_VERSION}",
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


def schema_text() -> str:
    """The content of the published file."""
    return json.dumps(json_schema(), indent=2, ensure_ascii=False) + "\n"


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
