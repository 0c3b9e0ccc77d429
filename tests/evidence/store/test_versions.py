"""Files of an earlier schema version are still read; files of a later one are refused."""

from __future__ import annotations

import csv
import gzip
import io
import json
from pathlib import Path

import gymnasium as gym
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from integ_gym.cli import main as run
from integ_gym.evidence.exporting import TEXT_FORMATS, export
from integ_gym.evidence.fields import LABELS, SCHEMA_VERSION, SUMMARY_FIELDS
from integ_gym.evidence.hashing import with_hashes
from integ_gym.evidence.labels import Replays, failure_sentence
from integ_gym.evidence.recomputing import course_of, failure_of
from integ_gym.evidence.recorder import RecordEvidence
from integ_gym.evidence.schema import VERSION_KEY, EvidenceError
from integ_gym.evidence.store import EvidenceStore

DATA = Path(__file__).parents[1] / "data"
LATER = tuple(field.name for field in SUMMARY_FIELDS if field.since > 1)


def _of_version(table, version):
    """A table as a file of that schema version has it, with the hashes of its records."""
    lacking = [field.name for field in SUMMARY_FIELDS if field.since > version]
    table = table.drop_columns(lacking)
    changed = {
        "schema_version": version,
        "package_versions": '{"integ-gym": "0.9.0"}',
        "engine_version": "0.9.0",
    }
    for name, value in changed.items():
        index = table.schema.get_field_index(name)
        field = table.schema.field(index)
        table = table.set_column(index, field, pa.array([value] * len(table), field.type))
    return with_hashes(table.replace_schema_metadata(_metadata(table, version)))


def _metadata(table, version):
    return table.schema.metadata | {VERSION_KEY: str(version).encode()}


@pytest.fixture
def table(store):
    return pq.read_table(store.files()[0])


@pytest.fixture
def old(tmp_path, table):
    """A store whose one file has version 1."""
    old = EvidenceStore(tmp_path / "old" / "evidence")
    old.commit("batch", _of_version(table, 1))
    return old


@pytest.fixture
def both(old, play, context):
    """A store with three records of version 1 and three of the present one."""
    env = gym.make("IntegPendulum-v0", duration=0.5)
    env = RecordEvidence(env, old, context, commit_on_close=False)
    play(env, range(3))
    env.commit("new", Replays(home_success=0.25, cell_status="achievable", second_horizon=False))
    return old


def test_an_earlier_version_is_not_taken_from_what_this_one_made(old, table, capsys):
    """Fields of later versions, and what is asked of them, are not escaped by another number."""
    directory = str(old.directory.parent)
    assert run(["evidence", "verify", directory, "--depth", "whole"]) == 0
    (file,) = old.files()
    kept = pq.read_table(file)
    index = kept.schema.get_field_index("package_versions")
    forged = kept.set_column(index, kept.schema.field(index), table.column("package_versions"))
    pq.write_table(with_hashes(forged), file)
    assert run(["evidence", "verify", directory, "--depth", "whole"]) == 1
    assert "it has schema version 1, and its records say that integ-gym" in capsys.readouterr().out


@pytest.fixture
def fourth(tmp_path):
    """A store of a file that was written when the schema version was 4, with every label."""
    run_directory = tmp_path / "fourth"
    (run_directory / "evidence").mkdir(parents=True)
    content = gzip.decompress((DATA / "version-4.parquet.gz").read_bytes())
    (run_directory / "evidence" / "version-4.parquet").write_bytes(content)
    return EvidenceStore(run_directory / "evidence")


def test_a_file_of_version_4_is_read_queried_and_verified(fourth, capsys):
    """Its reasons are sentences, which stay; they are derived again and compared."""
    records = list(fourth.records())
    labels = {record["failure_label"] for record in records}
    assert labels == set(LABELS)
    for record in records:
        assert record["schema_version"] == 4
        assert record["failure_numbers"] is None
        assert record.reason == record["failure_reason"]
        expected = failure_of(record.fields, course_of(record))
        assert failure_sentence({**record.fields, **expected.columns()}) == record.reason
    sql = "SELECT failure_reason, failure_numbers FROM records WHERE cell = 'euler'"
    ((sentence, numbers),) = (row.values() for row in fourth.query(sql).to_pylist())
    assert sentence.startswith("the same policy succeeds from the same start on its training")
    assert numbers is None
    assert run(["evidence", "verify", str(fourth.run), "--exact", "--all", "--no-progress"]) == 0
    assert "replayed: 17 of 17 records, 17 of them to the last bit" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("failure_reason", "it was the weather."),
        ("energy_end", 1.0),
        ("work_total", None),
        ("engine_version", "0.0.1"),
    ],
)
def test_as_much_is_asked_of_version_4_as_before(fourth, column, value, capsys):
    (file,) = fourth.files()
    table = pq.read_table(file)
    index = table.schema.get_field_index(column)
    field = table.schema.field(index)
    values = pa.array([value] * len(table), field.type)
    pq.write_table(with_hashes(table.set_column(index, field, values)), file)
    assert run(["evidence", "verify", str(fourth.run), "--depth", "whole", "--no-progress"]) == 1
    assert f"`{column}` is recorded as {value!r}" in capsys.readouterr().out


def test_an_older_file_is_read_with_null_for_what_it_lacks(old, table):
    assert old.count() == 3
    assert not set(LATER) & set(pq.read_schema(old.files()[0]).names)
    for record, before in zip(old.records(), table.to_pylist(), strict=True):
        assert record["schema_version"] == 1
        assert {record[name] for name in LATER} == {None}
        assert set(record.fields) == {field.name for field in SUMMARY_FIELDS}
        for field in SUMMARY_FIELDS:
            if field.name not in ("schema_version", "package_versions", "content_hash", *LATER):
                assert record[field.name] == before[field.name], field.name
        np.testing.assert_array_equal(record["theta"], before["theta"])
        assert old.find(record["record_id"]).fields == record.fields
        assert not set(LATER) & set(record.units)
    for record in old.records(trace=False):
        assert not record.trace
        assert {record[name] for name in LATER} == {None}


def test_an_older_file_keeps_its_hashes_and_is_verified(old, table):
    file = old.files()[0]
    kept = pq.read_table(file)
    assert old.verify() == []
    hashes = kept.column("content_hash").to_pylist()
    assert not set(hashes) & set(table.column("content_hash").to_pylist())
    index = kept.schema.get_field_index("success")
    pq.write_table(kept.set_column(index, kept.schema.field(index), [[True] * 3]), file)
    problems = old.verify()
    assert len(problems) == 3
    assert all("was altered" in problem.message for problem in problems)


def test_an_older_file_is_queried_with_null_for_what_it_lacks(old):
    names = ", ".join(LATER)
    rows = old.query(f"SELECT schema_version, {names} FROM records").to_pylist()
    assert rows == [{"schema_version": 1, **dict.fromkeys(LATER)}] * 3
    for condition in (
        "cell_status = 'too_slow'",
        "home_success < 0.5",
        "replay_home",
        "NOT replay_second_horizon",
    ):
        sql = f"SELECT count(*) AS n FROM records WHERE {condition}"
        assert old.query(sql).to_pylist() == [{"n": 0}], condition
    described = old.query("DESCRIBE records").column("column_name").to_pylist()
    assert {field.name for field in SUMMARY_FIELDS} <= set(described)
    assert len(set(described)) == len(described)
    with pytest.raises(EvidenceError, match="DuckDB refuses the query"):
        old.query("SELECT replay_elsewhere FROM records")


@pytest.mark.parametrize("form", TEXT_FORMATS)
def test_an_older_file_is_exported(old, form):
    file = io.StringIO()
    assert export(old, form, file) == (3, {})
    file.seek(0)
    if form == "csv":
        rows = list(csv.DictReader(file))
        assert all(list(row) == [field.name for field in SUMMARY_FIELDS] for row in rows)
        nothing = ""
    else:
        rows = [json.loads(line) for line in file]
        assert rows == [record.summary() for record in old.records()]
        nothing = None
    assert [int(row["schema_version"]) for row in rows] == [1] * 3
    assert {row[name] for row in rows for name in LATER} == {nothing}


def test_both_versions_in_one_store(both):
    """The columns have their types and the older rows null."""
    assert [problem.message.split(";")[0] for problem in both.verify()] == [
        "is also in batch.parquet"
    ] * 3
    rows = both.query(
        "SELECT schema_version, cell_status, home_success, replay_second_horizon, replay_home "
        "FROM records ORDER BY schema_version"
    )
    assert rows.to_pylist() == [
        {"schema_version": 1, **dict.fromkeys(rows.column_names[1:])},
    ] * 3 + [
        {"schema_version": SCHEMA_VERSION, "cell_status": "achievable", "home_success": 0.25,
         "replay_second_horizon": False, "replay_home": None},
    ] * 3  # fmt: skip
    assert [str(field.type) for field in rows.schema] == [
        "int64", "string", "double", "bool", "bool"
    ]  # fmt: skip
    records = list(both.records())
    assert [record["schema_version"] for record in records] == [1] * 3 + [SCHEMA_VERSION] * 3
    assert {frozenset(record.fields) for record in records} == {frozenset(records[0].fields)}
    file = io.StringIO()
    assert export(both, "csv", file) == (6, {})
    file.seek(0)
    assert [row["cell_status"] for row in csv.DictReader(file)] == [""] * 3 + ["achievable"] * 3


@pytest.mark.parametrize("version", [str(SCHEMA_VERSION + 1), "0", "-1", "01", "1.0", "", "none"])
def test_another_version_is_refused(store, table, version):
    other = store.directory / "other.parquet"
    metadata = table.schema.metadata | {VERSION_KEY: version.encode()}
    pq.write_table(table.replace_schema_metadata(metadata), other)
    message = (
        f"{other} has schema version {version}, and this integ-gym reads 1 to {SCHEMA_VERSION}; "
        "read it with the version that wrote it, or move it away"
    )
    for read in (lambda: list(store.records()), lambda: store.query("SELECT 1")):
        with pytest.raises(EvidenceError) as refused:
            read()
        assert str(refused.value) == message
    assert [(problem.file, problem.message) for problem in store.verify()] == [
        ("other.parquet", message)
    ]


@pytest.mark.parametrize("version", sorted({field.since for field in SUMMARY_FIELDS} - {5}))
def test_a_file_of_any_version_has_what_its_version_had(tmp_path, table, version):
    store = EvidenceStore(tmp_path / "evidence")
    store.commit("batch", _of_version(table, version))
    assert store.verify() == []
    (field, *_) = [field.name for field in SUMMARY_FIELDS if field.since == version]
    for record, before in zip(store.records(), table.to_pylist(), strict=True):
        assert record[field] == before[field]
        assert version >= 3 or record["arrival_time"] is None


@pytest.mark.parametrize("name", LATER)
def test_a_file_that_lacks_a_column_of_its_version_is_refused(store, table, name):
    file = store.files()[0]
    pq.write_table(table.drop_columns([name]), file)
    with pytest.raises(EvidenceError, match=f"lacks the columns {name}; restore it from a copy"):
        list(store.records())
    with pytest.raises(EvidenceError, match=f"lacks the columns {name};"):
        store.query("SELECT 1")
    (problem,) = store.verify()
    assert f"lacks the columns {name};" in problem.message
