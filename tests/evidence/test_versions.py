"""Files of an earlier schema version are still read; files of a later one are refused."""

import csv
import gzip
import io
import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from forgery import with_column

from integ_gym.cli import main as run
from integ_gym.evidence.exporting import TEXT_FORMATS, export
from integ_gym.evidence.fields import LABELS, SCHEMA_VERSION, SUMMARY_FIELDS
from integ_gym.evidence.hashing import with_hashes
from integ_gym.evidence.labels import failure_sentence
from integ_gym.evidence.recomputing import course_of, failure_of
from integ_gym.evidence.schema import VERSION_KEY, EvidenceError
from integ_gym.evidence.store import EvidenceStore

FOURTH = Path(__file__).with_name("version-4.parquet.gz")
STATED = ("schema_version", "package_versions", "engine_version")
LATER = tuple(field.name for field in SUMMARY_FIELDS if field.since > 1)


def _of_version(table, version):
    """A table as a file of that schema version has it, with the hashes of its records."""
    table = table.drop_columns([field.name for field in SUMMARY_FIELDS if field.since > version])
    values = (version, '{"integ-gym": "0.9.0"}', "0.9.0")
    for name, value in zip(STATED, values, strict=True):
        table = with_column(table, name, [value] * len(table))
    return with_hashes(_stating(table, str(version)))


def _stating(table, version):
    return table.replace_schema_metadata(table.schema.metadata | {VERSION_KEY: version.encode()})


@pytest.fixture
def old(tmp_path, table):
    """A store whose one file has version 1."""
    old = EvidenceStore(tmp_path / "old" / "evidence")
    old.commit("batch", _of_version(table, 1))
    return old


def test_an_earlier_version_is_not_taken_from_what_this_one_made(old, table, capsys):
    """Fields of later versions, and what is asked of them, are not escaped by another number."""
    verify = ["evidence", "verify", str(old.run), "--depth", "whole", "--no-progress"]
    assert run(verify) == 0
    (file,) = old.files()
    versions = table.column("package_versions").to_pylist()
    pq.write_table(
        with_hashes(with_column(pq.read_table(file), "package_versions", versions)), file
    )
    assert run(verify) == 1
    assert "it has schema version 1, and its records say that integ-gym" in capsys.readouterr().out


@pytest.fixture
def fourth(tmp_path):
    """A store of a file that was written when the schema version was 4, with every label."""
    store = EvidenceStore(tmp_path / "fourth" / "evidence")
    store.directory.mkdir(parents=True)
    file = store.directory / "version-4.parquet"
    file.write_bytes(gzip.decompress(FOURTH.read_bytes()))
    return store


def test_a_file_of_version_4_is_read_queried_and_verified(fourth, capsys):
    """Its reasons are sentences, which stay; they are derived again and compared."""
    records = list(fourth.records())
    assert {record["failure_label"] for record in records} == {*LABELS} - {"contract_error"}
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
    assert "replayed: 17 of 17 records, 17 of them to the last bit\n" in capsys.readouterr().out


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
    pq.write_table(with_hashes(with_column(table, column, [value] * len(table))), file)
    assert run(["evidence", "verify", str(fourth.run), "--depth", "whole", "--no-progress"]) == 1
    assert f"`{column}` is recorded as {value!r}" in capsys.readouterr().out


@pytest.mark.parametrize("form", TEXT_FORMATS)
def test_two_versions_in_one_store_are_read_queried_and_exported_together(old, table, form):
    """The columns have their types and the older rows null."""
    said = {"cell_status": "achievable", "home_success": 0.25, "replay_second_horizon": False}
    for name, value in said.items():
        table = with_column(table, name, [value] * 3)
    old.commit("new", with_hashes(with_column(table, "run_id", ["new"] * 3)))
    names = ("schema_version", *said, "replay_home")
    rows = old.query(f"SELECT {', '.join(names)} FROM records ORDER BY schema_version")
    new = {"schema_version": SCHEMA_VERSION, **said, "replay_home": None}
    older = {"schema_version": 1, **dict.fromkeys(names[1:])}
    assert rows.to_pylist() == [older] * 3 + [new] * 3
    kinds = ["int64", "string", "double", "bool", "bool"]
    assert [str(field.type) for field in rows.schema] == kinds
    records = list(old.records())
    assert [record["schema_version"] for record in records] == [1] * 3 + [SCHEMA_VERSION] * 3
    assert records[0].fields.keys() == records[5].fields.keys()
    file = io.StringIO()
    assert export(old, form, file) == (6, {})
    file.seek(0)
    if form == "csv":
        exported = list(csv.DictReader(file))
        assert all(list(row) == [field.name for field in SUMMARY_FIELDS] for row in exported)
        nothing = ""
    else:
        exported = [json.loads(line) for line in file]
        assert exported == [record.summary() for record in records]
        nothing = None
    assert {row[name] for row in exported[:3] for name in LATER} == {nothing}
    assert {row["cell_status"] for row in exported[3:]} == {"achievable"}


@pytest.mark.parametrize("version", [str(SCHEMA_VERSION + 1), "0", "01", "1.0", "", "none"])
def test_another_version_is_refused(store, table, version):
    other = store.directory / "other.parquet"
    pq.write_table(_stating(table, version), other)
    message = f"{other} has schema version {version}, and this integ-gym reads 1 to"
    for read in (lambda: list(store.records()), lambda: store.query("SELECT 1")):
        with pytest.raises(EvidenceError) as refused:
            read()
        assert str(refused.value).startswith(message)
    (problem,) = store.verify()
    assert problem.file == "other.parquet"
    assert problem.message.startswith(message)


def test_a_file_has_all_that_its_version_had_or_is_refused(tmp_path, table):
    for version in sorted({field.since for field in SUMMARY_FIELDS} - {SCHEMA_VERSION}):
        store = EvidenceStore(tmp_path / str(version))
        store.commit("batch", _of_version(table, version))
        assert store.verify() == []
        name = next(field.name for field in SUMMARY_FIELDS if field.since == version)
        (file,) = store.files()
        told = [record[name] for record in store.records()]
        assert told == pq.read_table(file).column(name).to_pylist()
    store = EvidenceStore(tmp_path / "now")
    store.commit("batch", table)
    (file,) = store.files()
    for name in LATER:
        pq.write_table(table.drop_columns([name]), file)
        for read in (lambda: list(store.records()), lambda: store.query("SELECT 1")):
            with pytest.raises(EvidenceError, match=rf"lacks the columns {name}; restore it"):
                read()
        (problem,) = store.verify()
        assert f"lacks the columns {name};" in problem.message
