"""A query reads the records of its run, and nothing else in the world."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from integ_gym.evidence.schema import EvidenceError
from integ_gym.evidence.store import EvidenceStore

WRITING = (
    "COPY (PIVOT records ON env_id USING count(*)) TO '{file}'",
    "COPY (PIVOT records ON env_id USING count(*)) TO '{file}' (USE_TMP_FILE false)",
    "COPY records TO '{file}'",
    "EXPLAIN ANALYZE COPY records TO '{file}'",
    "CREATE TABLE mine AS PIVOT records ON env_id USING count(*)",
    "CREATE TABLE mine AS SELECT 1",
    "INSERT INTO records SELECT * FROM records",
    "SET enable_external_access = true",
    "SELECT 1) TO '{file}' --",
    "SELECT 1; SELECT 2",
    "INSTALL httpfs",
    "LOAD httpfs",
    "PRAGMA enable_profiling",
    "ATTACH '{file}.db'",
    "EXPORT DATABASE '{file}.d'",
    "CALL pragma_version()",
    "",
)

READING_ELSEWHERE = (
    "SELECT * FROM read_csv('/etc/passwd')",
    "SELECT * FROM read_text('/etc/passwd')",
    "SELECT * FROM read_blob('/proc/self/environ')",
    "SELECT * FROM glob('/*')",
    "SELECT * FROM '/etc/passwd'",
    "SELECT * FROM read_parquet('{other}')",
    "SELECT * FROM 'https://example.org/a.parquet'",
    "SELECT * FROM read_csv('s3://bucket/a.csv')",
    "SELECT * FROM sqlite_scan('{other}', 'x')",
)

READING = (
    "SELECT 1;",
    "SELECT 1 -- as an example",
    "DESCRIBE records",
    "SUMMARIZE records",
    "FROM records",
    "VALUES (1), (2)",
    "WITH a AS (PIVOT records ON env_id USING count(*)) SELECT * FROM a",
    "SELECT * FROM records ORDER BY episode_index DESC LIMIT 1",
)


def test_nothing_can_be_written(store):
    (file,) = store.files()
    before = file.read_bytes()
    for sql in WRITING:
        with pytest.raises(EvidenceError):
            store.query(sql.format(file=file))
        assert file.read_bytes() == before, sql
        assert list(store.directory.iterdir()) == [file], sql


def test_nothing_else_can_be_read(store, tmp_path_factory):
    other = tmp_path_factory.mktemp("other") / "other.parquet"
    shutil.copy(store.files()[0], other)
    for sql in READING_ELSEWHERE:
        with pytest.raises(EvidenceError, match="DuckDB refuses the query"):
            store.query(sql.format(other=other))


def test_what_reads_is_run(store):
    for sql in READING:
        assert store.query(sql).num_rows > 0, sql


def test_what_does_not_fit_into_memory_goes_nowhere_near_the_run(store, monkeypatch):
    monkeypatch.chdir(store.directory)
    before = sorted(store.directory.rglob("*"))
    (told,) = store.query("SELECT current_setting('temp_directory') AS place").to_pylist()
    place = Path(told["place"])
    assert store.directory not in (place, *place.parents)
    assert place.parent == Path(tempfile.gettempdir())
    assert not place.exists()
    assert sorted(store.directory.rglob("*")) == before


def test_a_directory_is_named_by_its_own_name_alone(store, tmp_path):
    for name in ("aXb", "a*b", "a?b", "a[X]b", "a'b", 'a"b', "a b", "ä"):
        (tmp_path / name).mkdir()
        shutil.copy(store.files()[0], tmp_path / name)
        found = EvidenceStore(tmp_path / name).query("SELECT count(*) AS n FROM records")
        assert found.to_pylist() == [{"n": 3}], name


HEEDING = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from integ_gym.cli import main
sys.exit(main(sys.argv[1:]))
"""


def test_an_interruption_ends_a_query_at_once(store):
    long = "SELECT count(*) FROM range(1000000) a, range(1000000) b WHERE a.range * b.range % 7 = 3"
    command = [sys.executable, "-c", HEEDING, "evidence", "query", str(store.directory), long]
    with subprocess.Popen(command, stderr=subprocess.PIPE) as process:
        assert process.stderr is not None
        while not _working(process.pid):
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        try:
            assert process.wait(timeout=60.0) == 130
        finally:
            process.kill()
        assert b"interrupted" in process.stderr.read()


def _working(pid):
    """Whether a process has started DuckDB's threads, or has but one core to work with."""
    with open(f"/proc/{pid}/maps", encoding="ascii", errors="replace") as maps:
        loaded = "duckdb" in maps.read()
    with open(f"/proc/{pid}/stat", encoding="ascii") as stat:
        ticks = sum(map(int, stat.read().split()[13:15]))
    return loaded and ticks > 3 * os.sysconf("SC_CLK_TCK")
