"""The store: atomic batches, reading, checking, putting together."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from forgery import with_column
from recording import recorded

from integ_gym.cli import main
from integ_gym.evidence.hashing import with_hashes
from integ_gym.evidence.schema import BatchExistsError, EvidenceError
from integ_gym.evidence.store import EvidenceStore, merge, open_run
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


def test_killed_writer_leaves_nothing_visible(store, table):
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(store.files()[0]), str(store.directory)],
        stdout=subprocess.PIPE,
    )
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
    store.commit("late", with_column(table, "record_id", ["a", "b", "c"]))
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
def test_the_later_of_two_writers_is_refused_and_a_failed_one_leaves_nothing(
    tmp_path, monkeypatch, linked
):
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

    def fail(temporary):
        temporary.write_text("half")
        raise RuntimeError("disk full")

    with pytest.raises(RuntimeError, match="disk full"):
        write_once(tmp_path / "another", fail)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", ["", "../up", ".hidden", "a b", "x" * 200])
def test_names_that_cannot_be_files_are_refused(store, table, name):
    with pytest.raises(ValueError, match="a batch name has"):
        store.commit(name, table)


def test_several_tables_make_one_batch(store, table, monkeypatch):
    store.commit_all("more", [table.slice(0, 1), None, table.slice(1)])
    assert pq.read_table(store.directory / "more.parquet").equals(table)
    assert store.count() == 6
    many = pa.concat_tables([table] * 500)
    for name, group_bytes, groups in (("many", None, 1), ("long", 1, 3)):
        if group_bytes:
            monkeypatch.setattr("integ_gym.evidence.parquet_file._GROUP_BYTES", group_bytes)
        store.commit_all(name, (table for _ in range(500)))
        file = store.directory / f"{name}.parquet"
        assert pq.read_table(file).equals(many)
        assert pq.read_metadata(file).num_row_groups == groups
    with pytest.raises(ValueError, match="at least one record"):
        store.commit_all("none", [None])
    assert "none" not in store.batches()


def test_find_by_id_and_by_prefix(store, table):
    ids = [record["record_id"] for record in store.records()]
    for k, record_id in enumerate(ids):
        assert store.find(record_id)["episode_index"] == k
        length = next(n for n in range(1, 33) if sum(i.startswith(record_id[:n]) for i in ids) == 1)
        assert store.find(record_id[:length])["record_id"] == record_id
    with pytest.raises(EvidenceError, match=r"3 records of .* begin with ''.*give more digits"):
        store.find("")
    with pytest.raises(EvidenceError, match="no record 'zzz'"):
        store.find("zzz")
    store.commit("longer", with_column(table, "record_id", [ids[0] + "0", "b", "c"]))
    assert store.find(ids[0])["record_id"] == ids[0]


def test_query_unites_the_columns_of_all_environments(two_environments):
    store = open_run(two_environments)
    rows = store.query(
        "SELECT env_id, count(*) AS n, count(theta) AS theta, count(x) AS x, "
        "count(torque_applied) AS torque FROM records GROUP BY env_id ORDER BY env_id"
    ).to_pylist()
    assert rows == [
        {"env_id": "IntegCartPole-v0", "n": 3, "theta": 3, "x": 3, "torque": 0},
        {"env_id": "IntegPendulum-v0", "n": 3, "theta": 3, "x": 0, "torque": 3},
    ]


def test_verify_finds_altered_values(store, table):
    (file,) = store.files()
    assert store.verify() == []
    returns = table.column("return").to_pylist()
    pq.write_table(with_column(table, "return", [returns[0], returns[1] + 1e-9, returns[2]]), file)
    (problem,) = store.verify()
    assert problem.record_id == table.column("record_id")[1].as_py()
    assert "was altered" in str(problem)
    theta = table.column("theta").to_pylist()
    theta[2][5] = float(np.nextafter(theta[2][5], np.inf))
    pq.write_table(with_column(table, "theta", theta), file)
    (problem,) = store.verify()
    assert problem.record_id == table.column("record_id")[2].as_py()
    pq.write_table(with_column(table, "platform", ["elsewhere"] * 3), file)
    assert store.verify() == []


def test_verify_finds_records_that_are_there_twice(store, table):
    store.commit("copy", table.slice(1, 1))
    (problem,) = store.verify()
    assert problem.file == "copy.parquet"
    assert problem.message.startswith("is also in batch.parquet")


def test_verify_finds_broken_and_foreign_files(store, table):
    directory = store.directory
    (directory / "broken.parquet").write_bytes(b"PAR1 this is not Parquet")
    half = bytearray(store.files()[0].read_bytes())
    half[len(half) // 3 : len(half) // 2] = bytes(len(half) // 2 - len(half) // 3)
    (directory / "corrupt.parquet").write_bytes(half)
    pq.write_table(pa.table({"x": [1]}), directory / "foreign.parquet")
    problems = {problem.file: problem.message for problem in store.verify()}
    assert "cannot read" in problems["broken.parquet"]
    assert "corrupt.parquet" in problems
    assert "schema version none" in problems["foreign.parquet"]
    assert "batch.parquet" not in problems


def test_open_run(two_environments, tmp_path):
    for given in (two_environments, two_environments / "evidence"):
        assert open_run(given).directory == two_environments / "evidence"
    with pytest.raises(EvidenceError, match="no directory"):
        open_run(tmp_path / "nowhere")
    with pytest.raises(EvidenceError, match="holds no evidence"):
        open_run(tmp_path)
    with pytest.raises(EvidenceError, match="holds no evidence"):
        EvidenceStore(tmp_path).query("SELECT 1")


def _hashes(store):
    return {r["record_id"]: r["content_hash"] for r in store.records(trace=False)}


@pytest.fixture
def other(tmp_path_factory):
    """A store whose episodes 0 to 4 go beyond those of ``store``, the same as far as it goes."""
    return recorded(tmp_path_factory.mktemp("other"), range(5))


def test_runs_put_together_hold_each_record_once(
    store, other, two_environments, tmp_path_factory, capsys
):
    target = EvidenceStore(tmp_path_factory.mktemp("both"))
    third = EvidenceStore(two_environments / "evidence")
    assert merge([store, other, third], target) == (11, 3)
    assert _hashes(target) == _hashes(store) | _hashes(other) | _hashes(third)
    assert target.verify() == []
    assert merge([other, store], target) == (0, 8)
    out = str(tmp_path_factory.mktemp("out"))
    assert (
        main(["evidence", "merge", str(store.directory), str(other.directory), "--out", out]) == 0
    )
    assert capsys.readouterr().out.startswith(f"5 records written to {out}, 3 were there already")


def test_what_cannot_be_merged_is_refused_before_anything_is_written(store, table, tmp_path):
    forged, target = EvidenceStore(tmp_path / "forged"), EvidenceStore(tmp_path / "both")
    forged.commit("batch", with_hashes(with_column(table, "run_id", ["another"] * 3)))
    with pytest.raises(EvidenceError, match="differs from the one with that id"):
        merge([store, forged], target)
    pq.write_table(pa.concat_tables([table, table]), store.files()[0])
    with pytest.raises(EvidenceError, match=r"is damaged: .*; mend it before it is merged"):
        merge([store], target)
    assert target.files() == []
