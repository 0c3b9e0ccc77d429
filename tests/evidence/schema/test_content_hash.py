"""The content hash tells every change but those of the volatile group."""

from __future__ import annotations

import hashlib
import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from integ_gym.evidence.fields import COMMON_TRACE, SUMMARY_FIELDS, VOLATILE_NAMES
from integ_gym.evidence.hashing import content_hashes
from integ_gym.evidence.schema import described, is_trace


@pytest.fixture
def table(store):
    return pq.read_table(store.files()[0])


def _altered(value):
    """Another value of the same type."""
    if value is None:
        return None
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return value + " "
    if isinstance(value, float):
        return float(np.nextafter(value, np.inf))
    if isinstance(value, int):
        return value + 1
    if isinstance(value, list):
        first = value[0]
        step = float(np.nextafter(np.float32(first), np.inf))
        return [step if isinstance(first, float) else first + 1, *value[1:]]
    return value.replace(year=1999)


def _with(table, name, values):
    index = table.schema.get_field_index(name)
    field = table.schema.field(name)
    return table.set_column(index, field, pa.array(values, field.type))


def test_hash_is_stored_and_stable(table):
    stored = table.column("content_hash").to_pylist()
    assert len(set(stored)) == 3
    assert content_hashes(table) == stored
    order = sorted(table.column_names, reverse=True)
    assert content_hashes(table.select(order)) == stored
    assert content_hashes(table.slice(1, 1)) == stored[1:2]
    assert content_hashes(pa.concat_tables([table, table.slice(0, 2)])) == stored + stored[:2]


def test_hash_is_the_documented_one(table):
    """The same hash from its description, without the code that made it."""
    record = table.slice(2, 1)
    names = sorted(name for name in record.column_names if name not in VOLATILE_NAMES)
    kinds = {}
    for name in names:
        field = record.schema.field(name)
        kind = field.type
        kind = f"list<{kind.value_type}>" if isinstance(kind, pa.ListType) else str(kind)
        kinds[name] = [kind, described(field)["unit"], described(field)["frame"]]
    row = record.to_pylist()[0]
    values = {name: row[name] for name in names if is_trace(name)}
    present = {k: v and [x for x in v if x is not None] for k, v in values.items()}
    counts = {name: None if v is None else len(v) for name, v in present.items()}
    fields = {name: row[name] for name in names if not is_trace(name)}

    def text(value):
        return json.dumps(value, separators=(",", ":"), ensure_ascii=False).encode()

    types = {"double": "<f8", "float": "<f4", "int32": "<i4", "int8": "<i1"}
    data = b"".join(
        np.array(v, types[kinds[name][0][5:-1]]).tobytes() for name, v in present.items() if v
    )
    expected = hashlib.sha256(text(kinds) + text([fields, counts]) + data).hexdigest()
    assert row["content_hash"] == expected


ODD = {
    "no nulls at the ends": [[None, 1.0, None, 2.0], [3.0, None], [None]],
    "more nulls than rows": [[1.0, None, None], None, [None, None]],
    "empty and missing": [[], None, [0.5]],
    "zeros and none": [[-0.0], [0.0], [float("nan"), None]],
}
"""Values of a trace column that recorders do not write, and other programs may."""


@pytest.mark.parametrize("values", ODD.values(), ids=ODD)
def test_rows_hash_together_as_they_do_alone(table, values):
    changed = _with(_with(table, "theta", values), "energy_residual_total", [0.0, -0.0, None])
    hashes = content_hashes(changed)
    assert len(set(hashes)) == 3
    for row, together in enumerate(hashes):
        alone = changed.slice(row, 1)
        (expected,) = content_hashes(pa.Table.from_pylist(alone.to_pylist(), changed.schema))
        assert together == expected


def test_rows_without_a_trace_have_a_hash(table):
    summaries = table.select([name for name in table.column_names if not is_trace(name)])
    hashes = content_hashes(summaries)
    assert len(set(hashes)) == 3
    assert content_hashes(summaries.slice(1, 1)) == hashes[1:2]


def test_zeros_of_both_signs_differ(table):
    same = _with(table, "energy_residual_total", [0.0, 0.0, 0.0])
    other = _with(table, "energy_residual_total", [0.0, -0.0, 0.0])
    assert [a == b for a, b in zip(content_hashes(same), content_hashes(other), strict=True)] == [
        True, False, True,
    ]  # fmt: skip


@pytest.mark.parametrize("field", SUMMARY_FIELDS, ids=lambda field: field.name)
def test_every_field_counts_unless_volatile(table, field):
    values = table.column(field.name).to_pylist()
    filled = {"float64": 1.5, "int64": 1, "string": "x", "json": "{}", "bool": False}
    changed = [filled[field.kind] if value is None else _altered(value) for value in values]
    before, after = content_hashes(table), content_hashes(_with(table, field.name, changed))
    if field.name in VOLATILE_NAMES:
        assert after == before
    else:
        assert not set(after) & set(before)


@pytest.mark.parametrize("name", ["theta", "sensed_cos_theta", *(f.name for f in COMMON_TRACE)])
def test_every_trace_value_counts(table, name):
    values = table.column(name).to_pylist()
    before = content_hashes(table)
    for changed in (
        [_altered(value) for value in values],
        [value[:-2] for value in values],
        [None for _ in values],
        [[] for _ in values],
    ):
        assert not set(content_hashes(_with(table, name, changed))) & set(before)


def test_unit_frame_type_and_columns_count(table):
    before = set(content_hashes(table))
    index = table.schema.get_field_index("theta")
    field = table.schema.field(index)
    for metadata in ({b"unit": b"deg"}, {b"frame": b"elsewhere"}):
        changed = table.set_column(
            index, field.with_metadata({**field.metadata, **metadata}), table.column(index)
        )
        assert not set(content_hashes(changed)) & before
    assert not set(content_hashes(table.drop_columns(["theta"]))) & before
    narrow = table.column(index).cast(pa.list_(pa.float32()))
    assert not set(content_hashes(table.set_column(index, "theta", narrow))) & before
