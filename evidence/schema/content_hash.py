"""The content hash of a record: what tells whether it is still what was written."""

from __future__ import annotations

import hashlib
import json
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .arrow import described, is_trace
from .extra import pyarrow
from .fields import VOLATILE_NAMES

_BY_COMMAS, _BY_LINES = (
    json.JSONEncoder(separators=(separator, ":"), ensure_ascii=False) for separator in (",", "\n")
)


class _Flat(NamedTuple):
    """A trace column without its nulls: row i owns bytes ends[i] … ends[i + 1]."""

    data: memoryview
    ends: list[int]
    counts: list[int | None]


def content_hashes(table: Any) -> list[str]:
    """SHA-256 of every row of a table of records.

    The hash is taken over, in this order:

    1. JSON of {column: [Arrow type, unit, frame]} for all columns but the volatile ones;
    2. JSON of [fields, counts]: the row's values outside the trace, and for each trace column the
       number of its values that are not null, or null;
    3. those values, column by column, little-endian.

    Columns go by name in ascending order. JSON is UTF-8 with no spaces; floats are the shortest
    decimal that reads back the same.

    Args:
        table: Arrow table with the columns of one file.
    """
    if not table.num_rows:
        return []
    names = sorted(name for name in table.column_names if name not in VOLATILE_NAMES)
    about = {name: _signature(table.schema.field(name)) for name in names}
    start = hashlib.sha256(_json(about).encode())
    fields = _objects({n: _texts(table.column(n)) for n in names if not is_trace(n)})
    flat = {name: _flatten(table.column(name)) for name in names if is_trace(name)}
    counts = _objects({name: _json_of_all(column.counts) for name, column in flat.items()})
    columns = list(flat.values())
    hashes = []
    for i in range(table.num_rows):
        digest = start.copy()
        parts = [column.data[column.ends[i] : column.ends[i + 1]] for column in columns]
        digest.update(b"".join([f"[{fields[i]},{counts[i]}]".encode(), *parts]))
        hashes.append(digest.hexdigest())
    return hashes


def _signature(field: Any) -> list[str]:
    about, kind = described(field), field.type
    named = f"list<{kind.value_type}>" if pyarrow().types.is_list(kind) else str(kind)
    return [named, about["unit"], about["frame"]]


def _json(value: Any) -> str:
    return _BY_COMMAS.encode(value)


def _objects(columns: dict[str, list[str]]) -> list[str]:
    """JSON of {column: value} for every row, from the JSON of every value."""
    rows = len(next(iter(columns.values()), ()))
    varying: list[list[str]] = []
    between = "{"
    for place, (name, texts) in enumerate(columns.items()):
        between += f"{',' if place else ''}{_json(name)}:"
        if texts.count(texts[0]) == rows:
            between += texts[0]
        else:
            varying.append([between + text for text in texts])
            between = ""
    varying.append([between + "}"] * rows)
    return list(map("".join, zip(*varying, strict=True)))


def _texts(column: Any) -> list[str]:
    """JSON of every value of a column; what is there many times is encoded once."""
    types = pyarrow().types
    if types.is_list(column.type):
        return list(map(_json, column.to_pylist()))
    if not types.is_string(column.type):
        return _json_of_all(column.to_pylist())
    coded = column.combine_chunks().dictionary_encode()
    texts = [*_json_of_all(coded.dictionary.to_pylist()), "null"]
    return [texts[-1 if place is None else place] for place in coded.indices.to_pylist()]


def _json_of_all(values: list[Any]) -> list[str]:
    """JSON of scalars, which has no line break, so that all are encoded at once."""
    return _BY_LINES.encode(values)[1:-1].split("\n") if values else []


def _flatten(column: Any) -> _Flat:
    array = column.combine_chunks()
    present = array.is_valid().to_numpy(zero_copy_only=False)
    lengths = np.where(present, array.value_lengths().fill_null(0).to_numpy(), 0)
    ends = _ends(lengths)
    values = array.flatten()
    if values.null_count:
        nulls = values.is_null().to_numpy(zero_copy_only=False).nonzero()[0]
        ends = ends - np.searchsorted(nulls, ends)
        values = values.drop_null()
    numbers = values.to_numpy(zero_copy_only=False)
    numbers = np.ascontiguousarray(numbers, dtype=numbers.dtype.newbyteorder("<"))
    counts: list[int | None] = np.diff(ends).tolist()
    if not present.all():
        counts = [n if there else None for n, there in zip(counts, present, strict=True)]
    return _Flat(numbers.view(np.uint8).data, (ends * numbers.itemsize).tolist(), counts)


def _ends(lengths: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
    ends: npt.NDArray[np.int64] = np.concatenate(([0], np.cumsum(lengths, dtype=np.int64)))
    return ends


def with_hashes(table: Any) -> Any:
    """``table`` with its column ``content_hash`` filled in."""
    index = table.schema.get_field_index("content_hash")
    hashes = pyarrow().array(content_hashes(table), pyarrow().string())
    return table.set_column(index, table.schema.field(index), hashes)
