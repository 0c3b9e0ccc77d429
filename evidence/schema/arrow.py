"""Arrow schema of a record, and the fields read back from one."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from .extra import pyarrow
from .fields import SCHEMA_VERSION, SUMMARY_FIELDS, Field

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
