"""The store: atomic batches, reading, checking."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from integ_gym.evidence.fields import SCHEMA_VERSION
from integ_gym.evidence.schema import VERSION_KEY, BatchExistsError, EvidenceError
from integ_gym.evidence.store import EvidenceStore, open_run
from integ_gym.support.files import LEFTOVER_AGE, write_once

WRITER = """
import sys, time
import pyarrow as pa
import pyarrow.parquet as pq
from integ_gym.evidence.store import EvidenceStore

table = pa.concat_tables([pq.read_table(sys.argv[1])] * 100).combine_chunks()

def tables():
    yield from [table] * 250
    print("writing", flush=True)
    time.sleep(600.0)

EvidenceStore(sys.argv[2]).commit_all("late", tables())
"""


@pytest.fixture
def table(store):
    return pq.read_table(store.files()[0])


def _rewrite(file, table):
    pq.write_table(table, file)


def _with(table, name, values):
    index = table.schema.get_field_index(name)
    field = table.schema.field(name)
    return table.set_column(index, field, pa.array(values, field.type))


def test_killed_writer_leaves_nothing_visible(store, table):
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(store.files()[0]), str(store.directory)],
        stdout=subprocess.PIPE,
    )
    assert writer.stdout is not None
    assert writer.stdout.readline() == b"writing\n"
    writer.send_signal(signal.SIGKILL)
    writer.wait()
    writer.stdout.close()
    (leftover,) = store.directory.glob(".late*")
    assert leftover.stat().st_size > 0
    with pytest.raises(pa.ArrowInvalid):
        pq.read_table(leftover)
    assert store.batches() == ("batch",)
    assert len(list(store.records())) == 3
    assert store.query("SELECT count(*) AS n FROM records").to_pylist() == [{"n": 3}]
    assert store.verify() == []
    store.commit("late", _with(table, "record_id", ["a", "b", "c"]))
    assert store.batches() == ("batch", "late")
    assert leftover.exists(), "another writer may still be at it"
    old = time.time() - LEFTOVER_AGE - 1.0
    os.utime(leftover, (old, old))
    store.commit("later", table)
    assert not leftover.exists()


def test_committed_batch_is_never_overwritten(store, table):
    before = store.files()[0].read_bytes()
    with pytest.raises(BatchExistsError, match="'batch' has already been committed"):
        store.commit("batch", table.slice(0, 1))
    assert store.files()[0].read_bytes() == before
    assert [file.name for file in store.directory.iterdir()] == ["batch.parquet"]


@pytest.mark.parametrize("linked", [True, False])
def test_the_later_of_two_writers_is_refused(tmp_path, monkeypatch, linked):
    path = tmp_path / "file"
    if not linked:

        def no_links(source, target):
            raise PermissionError("no links here")

        monkeypatch.setattr(os, "link", no_links)

    def overtaken(temporary):
        temporary.write_text("second")
        write_once(path, lambda file: file.write_text("first") and None)

    with pytest.raises(FileExistsError):
        write_once(path, overtaken)
    assert path.read_text() == "first"
    assert list(tmp_path.iterdir()) == [path]


def test_failed_write_leaves_nothing(tmp_path):
    def fail(temporary):
        temporary.write_text("half")
        raise RuntimeError("disk full")

    with pytest.raises(RuntimeError, match="disk full"):
        write_once(tmp_path / "file", fail)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["", "../up", "a/b", ".hidden", "a b", "x" * 200])
def test_names_that_cannot_be_files_are_refused(store, table, name):
    with pytest.raises(ValueError, match="a batch name has"):
        store.commit(name, table)


def test_several_tables_make_one_batch(store, table, monkeypatch):
    store.commit_all("more", [table.slice(0, 1), None, table.slice(1)])
    assert pq.read_table(store.directory / "more.parquet").equals(table)
    assert store.count() == 6
    many = pa.concat_tables([table] * 500)
    store.commit_all("many", (table for _ in range(500)))
    file = store.directory / "many.parquet"
    assert pq.read_table(file).equals(many)
    assert pq.read_metadata(file).num_row_groups == 1
    monkeypatch.setattr("integ_gym.evidence.parquet_file._GROUP_BYTES", 1)
    store.commit_all("long", (table for _ in range(500)))
    file = store.directory / "long.parquet"
    assert pq.read_table(file).equals(many)
    assert pq.read_metadata(file).num_row_groups == 3
    with pytest.raises(ValueError, match="at least one record"):
        store.commit_all("none", [None])
    assert "none" not in store.batches()


def test_file_is_compressed_and_self_describing(store):
    metadata = pq.read_metadata(store.files()[0])
    group = metadata.row_group(0)
    assert {group.column(i).compression for i in range(group.num_columns)} == {"ZSTD"}
    schema = pq.read_schema(store.files()[0])
    assert schema.field("theta").metadata[b"unit"] == b"rad"
    assert b"upright" in schema.field("theta").metadata[b"frame"]
    assert schema.metadata[VERSION_KEY] == str(SCHEMA_VERSION).encode()


def test_find_by_id_and_by_prefix(store):
    ids = [record["record_id"] for record in store.records()]
    for k, record_id in enumerate(ids):
        assert store.find(record_id)["episode_index"] == k
        length = next(n for n in range(1, 33) if sum(i.startswith(record_id[:n]) for i in ids) == 1)
        assert store.find(record_id[:length])["record_id"] == record_id
    with pytest.raises(EvidenceError, match=r"3 records of .* begin with ''.*give more digits"):
        store.find("")
    with pytest.raises(EvidenceError, match="no record 'zzz'"):
        store.find("zzz")


def test_find_prefers_the_whole_id(store, table):
    record_id = table.column("record_id")[0].as_py()
    longer = _with(table, "record_id", [record_id + "0", "b", "c"])
    store.commit("longer", longer)
    assert store.find(record_id)["record_id"] == record_id


def test_query_unites_the_columns_of_all_environments(two_environments):
    store = open_run(two_environments)
    assert len(store.files()) == 2
    rows = store.query(
        "SELECT env_id, count(*) AS n, count(theta) AS theta, count(x) AS x, "
        "count(torque_applied) AS torque FROM records GROUP BY env_id ORDER BY env_id"
    ).to_pylist()
    assert rows == [
        {"env_id": "IntegCartPole-v0", "n": 3, "theta": 3, "x": 3, "torque": 0},
        {"env_id": "IntegPendulum-v0", "n": 3, "theta": 3, "x": 0, "torque": 3},
    ]


def test_trace_is_a_table_of_its_own(two_environments):
    store = open_run(two_environments)
    columns = ("time", "theta", "energy", "reward", "torque_applied", "energy_residual")
    trace = store.query(
        f"SELECT {', '.join(f'unnest({name}) AS {name}' for name in columns)} FROM records "
        "WHERE env_id = 'IntegPendulum-v0' AND episode_index = 1"
    )
    record = store.find(
        store.query(
            "SELECT record_id FROM records WHERE env_id = 'IntegPendulum-v0' AND episode_index = 1"
        ).to_pylist()[0]["record_id"]
    )
    assert trace.num_rows == record["length"] + 1
    for name in columns:
        values = trace.column(name).drop_null().to_numpy()
        np.testing.assert_array_equal(values, record[name])
        assert len(values) in (record["length"], record["length"] + 1)
        assert trace.column(name).null_count == record["length"] + 1 - len(values)
    assert trace.column("reward")[-1].as_py() is None


def test_verify_finds_altered_values(store, table):
    file = store.files()[0]
    assert store.verify() == []
    returns = table.column("return").to_pylist()
    _rewrite(file, _with(table, "return", [returns[0], returns[1] + 1e-9, returns[2]]))
    (problem,) = store.verify()
    assert problem.record_id == table.column("record_id")[1].as_py()
    assert "was altered" in str(problem)
    theta = table.column("theta").to_pylist()
    theta[2][5] = float(np.nextafter(theta[2][5], np.inf))
    _rewrite(file, _with(table, "theta", theta))
    (problem,) = store.verify()
    assert problem.record_id == table.column("record_id")[2].as_py()
    _rewrite(file, _with(table, "platform", ["elsewhere"] * 3))
    assert store.verify() == []


def test_verify_finds_records_that_are_there_twice(store, table):
    store.commit("copy", table.slice(1, 1))
    (problem,) = store.verify()
    assert (problem.file, problem.message.split(";")[0]) == (
        "copy.parquet",
        "is also in batch.parquet",
    )


def test_verify_finds_broken_and_foreign_files(store, table):
    directory = store.directory
    (directory / "broken.parquet").write_bytes(b"PAR1 this is not Parquet")
    whole = store.files()[0].read_bytes()
    half = bytearray(whole)
    half[len(half) // 3 : len(half) // 2] = bytes(len(half) // 2 - len(half) // 3)
    (directory / "corrupt.parquet").write_bytes(half)
    pq.write_table(pa.table({"x": [1]}), directory / "foreign.parquet")
    newer = table.schema.metadata | {VERSION_KEY: str(SCHEMA_VERSION + 1).encode()}
    pq.write_table(table.replace_schema_metadata(newer), directory / "newer.parquet")
    pq.write_table(table.drop_columns(["success"]), directory / "partial.parquet")
    problems = {problem.file: problem.message for problem in store.verify()}
    assert "cannot read" in problems["broken.parquet"]
    assert "corrupt.parquet" in problems
    assert "schema version none" in problems["foreign.parquet"]
    told = f"schema version {SCHEMA_VERSION + 1}, and this integ-gym reads 1 to {SCHEMA_VERSION};"
    assert told in problems["newer.parquet"]
    assert "lacks the columns success" in problems["partial.parquet"]
    assert "batch.parquet" not in problems


def test_open_run(two_environments, tmp_path):
    assert open_run(two_environments).directory == two_environments / "evidence"
    inner = open_run(two_environments / "evidence")
    assert inner.directory == two_environments / "evidence"
    with pytest.raises(EvidenceError, match="no directory"):
        open_run(tmp_path / "nowhere")
    with pytest.raises(EvidenceError, match="holds no evidence"):
        open_run(tmp_path)
    with pytest.raises(EvidenceError, match="holds no evidence"):
        EvidenceStore(tmp_path).query("SELECT 1")
