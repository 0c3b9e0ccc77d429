"""The content hash of a record: what tells whether it is still what was written."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from itertools import pairwise, repeat
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .fields import VOLATILE_NAMES
from .schema import compute, described, is_trace, pyarrow

Texts = str | list[str]
"""A text for every row, or one for all."""

_BY_COMMAS, _BY_LINES = (
    json.JSONEncoder(separators=(separator, ":"), ensure_ascii=False) for separator in (",", "\n")
)

_BYTES_AT_ONCE = 1 << 20
"""Of the trace, about, whose rows are laid out to be hashed."""


class _Flat(NamedTuple):
    """A trace column without its nulls."""

    rows: Any
    """The bytes of each row, as an Arrow array."""
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
    about = {}
    for name in names:
        said, kind = described(table.schema.field(name)), table.schema.field(name).type
        shown = f"list<{kind.value_type}>" if pyarrow().types.is_list(kind) else str(kind)
        about[name] = [shown, said["unit"], said["frame"]]
    fields = {name: _texts(table.column(name)) for name in names if not is_trace(name)}
    flat = {name: _flatten(table.column(name)) for name in names if is_trace(name)}
    counts = _counts({name: column.counts for name, column in flat.items()})
    same, pieces = _merge_constants([_json(about), "[", *_object(fields), ",", counts, "]"])
    start = hashlib.sha256(same.encode())
    hashes = []
    traces = _laid_out([column.rows for column in flat.values()], table.num_rows)
    rows = table.num_rows
    own = (repeat(x, rows) if isinstance(x, str) else x for x in pieces)
    for text, trace in zip(zip(repeat("", rows), *own, strict=True), traces, strict=True):
        digest = start.copy()
        digest.update("".join(text).encode())
        digest.update(trace)
        hashes.append(digest.hexdigest())
    return hashes


_json = _BY_COMMAS.encode


def _object(columns: dict[str, Texts]) -> Iterator[Texts]:
    """Pieces of the JSON of {column: value}, from the JSON of the values."""
    between = "{"
    for name, texts in columns.items():
        yield f"{between}{_json(name)}:"
        yield texts
        between = ","
    yield "}" if columns else "{}"


def _counts(columns: dict[str, list[int | None]]) -> Texts:
    """JSON of {column: count}; what is there many times is encoded once."""
    if not columns:
        return "{}"
    different = set(zip(*columns.values(), strict=True))
    known = {row: _json(dict(zip(columns, row, strict=True))) for row in different}
    return [known[row] for row in zip(*columns.values(), strict=True)]


def _merge_constants(pieces: Sequence[Texts]) -> tuple[str, list[Texts]]:
    """What all rows begin with; the pieces after it, with what all rows share put together."""
    merged: list[Texts] = [""]
    for piece in pieces:
        if isinstance(piece, str) and isinstance(merged[-1], str):
            merged[-1] += piece
        else:
            merged.append(piece)
    return str(merged[0]), merged[1:]


def _texts(column: Any) -> Texts:
    """JSON of the values of a column; what is there many times is encoded once."""
    types, array = pyarrow().types, column.combine_chunks()
    if types.is_list(array.type):
        texts = _json_of_all(_values(array.flatten()))
        ends = _ends(array.value_lengths().fill_null(0).to_numpy())
        lists = [f"[{','.join(texts[a:b])}]" for a, b in pairwise(ends)]
        for place in np.flatnonzero(array.is_null()):
            lists[place] = "null"
        return lists
    if _is_constant(array):
        return _json(array[0].as_py())
    if types.is_string(array.type):
        coded = array.dictionary_encode()
        texts = [*_json_of_all(coded.dictionary.to_pylist()), "null"]
        return [texts[place] for place in coded.indices.fill_null(-1).to_numpy().tolist()]
    return _json_of_all(_values(array))


def _is_constant(array: Any) -> bool:
    """Whether all values are the same to the bit."""
    if array.null_count:
        return bool(array.null_count == len(array))
    types = pyarrow().types
    bits = array.view(f"int{array.type.bit_width}") if types.is_floating(array.type) else array
    return bool(compute().all(compute().equal(bits, bits[0])).as_py())


def _values(array: Any) -> list[Any]:
    """Python's values."""
    types = pyarrow().types
    if array.null_count or not (types.is_integer(array.type) or types.is_floating(array.type)):
        values: list[Any] = array.to_pylist()
    else:
        values = array.to_numpy().tolist()
    return values


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
    pa = pyarrow()
    buffers = [None, pa.py_buffer(ends * numbers.itemsize), pa.py_buffer(numbers)]
    return _Flat(pa.Array.from_buffers(pa.large_binary(), len(ends) - 1, buffers), counts)


def _ends(lengths: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
    return np.concatenate(([0], np.cumsum(lengths, dtype=np.int64)))


def _laid_out(columns: list[Any], rows: int) -> Iterator[memoryview]:
    """The bytes of all columns, row by row."""
    if not columns:
        yield from repeat(memoryview(b""), rows)
        return
    pa = pyarrow()
    at_once = max(1, rows * _BYTES_AT_ONCE // max(1, sum(column.nbytes for column in columns)))
    for first in range(0, rows, at_once):
        parts = [column.slice(first, at_once) for column in columns]
        joined = compute().binary_join_element_wise(*parts, pa.scalar(b"", pa.large_binary()))
        _, offsets, data = joined.buffers()
        ends = np.frombuffer(offsets, np.int64, len(joined) + 1).tolist()
        whole = memoryview(data)
        yield from (whole[a:b] for a, b in pairwise(ends))


def with_hashes(table: Any) -> Any:
    """``table`` with its column ``content_hash`` filled in."""
    index = table.schema.get_field_index("content_hash")
    hashes = pyarrow().array(content_hashes(table), pyarrow().string())
    return table.set_column(index, table.schema.field(index), hashes)
