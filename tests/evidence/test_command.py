"""``integ-gym evidence``: what it prints, and how it refuses bad input."""

import csv
import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from forgery import with_column

from integ_gym.cli import main as run
from integ_gym.evidence.fields import SUMMARY_FIELDS
from integ_gym.evidence.printing import print_table, show, sparkline
from integ_gym.evidence.schema import VERSION_KEY, EvidenceError
from integ_gym.evidence.store import EvidenceStore, open_run


@pytest.fixture
def record_id(two_environments):
    rows = open_run(two_environments).query(
        "SELECT record_id FROM records WHERE env_id = 'IntegPendulum-v0' ORDER BY episode_index"
    )
    return rows.column("record_id")[0].as_py()


def main(*argv):
    """Run ``integ-gym evidence``; returns its exit code."""
    return run(["evidence", *map(str, argv)])


def _refused(capsys, *argv):
    """The one line that a refused command prints."""
    assert main(*argv) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("integ-gym evidence: ")
    assert captured.err.count("\n") == 1
    return captured.err


def test_show_prints_every_field_with_its_unit(two_environments, record_id, capsys):
    assert main("show", two_environments, record_id[:10]) == 0
    text = capsys.readouterr().out
    lines = {line.split()[0]: line for line in text.splitlines() if line.startswith("  ")}
    assert {field.name for field in SUMMARY_FIELDS} - {"arguments"} <= set(lines)
    assert lines["record_id"].endswith(record_id)
    assert lines["energy_start"].endswith(" J")
    assert lines["mass"].split() == ["mass", "1", "kg"]
    assert lines["theta_dot"].endswith("rad/s")
    assert lines["torque_applied"].endswith("N m")
    record = open_run(two_environments).find(record_id)
    bare = type(record)(record.fields, {}, record.units, record.frames)
    assert "no trace: trace_every is 1" in show(bare)


def test_a_terminal_without_unicode_is_shown_a_record(two_environments, record_id, monkeypatch):
    stream = io.BytesIO()
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(stream, "ascii", write_through=True))
    assert main("show", two_environments, record_id) == 0
    assert b"theta" in stream.getvalue()
    assert sparkline(np.arange(8.0)) == "▁▂▃▄▅▆▇█"


def _printed(table, form="table"):
    file = io.StringIO()
    print_table(table, file, form)
    return file.getvalue()


def test_what_would_move_the_cursor_is_shown():
    table = pa.table({"a\x1b[2J": ["x\x1b[31mred\x07", "y\x9b1A\u202e", "tab\tnew\nline"]})
    text = _printed(table)
    assert not set(text) & set("\x1b\x07\x9b\u202e")
    for shown in (r"a\x1b[2J", r"x\x1b[31mred\x07", r"y\x9b1A\u202e"):
        assert shown in text
    assert "x\x1b[31mred\x07" in _printed(table, "csv"), "a file is given every value as it is"


def test_query_csv_and_json_give_values_in_full(two_environments, record_id, capsys):
    sql = f"SELECT * FROM records WHERE record_id = '{record_id}'"
    record = open_run(two_environments).find(record_id)
    assert main("query", two_environments, sql, "--format", "json") == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row["theta"] == record["theta"].tolist()
    assert row["return"] == record["return"]
    assert row["wall_start"] == record["wall_start"].isoformat()
    assert row["time_to_success"] is None
    assert main("query", two_environments, sql, "--format", "csv") == 0
    (row,) = csv.DictReader(io.StringIO(capsys.readouterr().out))
    assert json.loads(row["theta"]) == record["theta"].tolist()
    assert float(row["return"]) == record["return"]
    assert row["time_to_success"] == ""
    assert json.loads(row["arguments"])


def test_verify(two_environments, capsys, store, table):
    assert main("verify", two_environments) == 0
    captured = capsys.readouterr()
    assert "records: 6, files: 2" in captured.out
    assert re.search(r" [1-9]\d?%.*outcomes from traces", captured.err)
    assert "100%" in captured.err
    pq.write_table(with_column(table, "success", [True] * 3), store.files()[0])
    assert main("verify", store.directory, "--no-progress") == 1
    captured = capsys.readouterr()
    assert captured.out.count("was altered") == 3
    assert captured.err == ""


def test_a_reader_that_stops_amid_many_records_is_no_error(two_environments):
    sql = "SELECT unnest(theta), unnest(time) FROM records, range(20)"
    query = ["evidence", "query", str(two_environments), sql]
    with subprocess.Popen(
        [sys.executable, "-m", "integ_gym.cli", *query],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    ) as process:  # fmt: skip
        process.stdout.readline()
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait() == 0


def test_bad_input_is_refused_with_one_sentence(two_environments, tmp_path, capsys):
    nowhere = tmp_path / "nowhere"
    for words, message in (
        (("show", nowhere, "a"), f"no directory {nowhere}"),
        (("query", tmp_path, "SELECT 1"), "holds no evidence"),
        (("show", two_environments, "zz"), "no record 'zz'"),
        (("show", two_environments, ""), "give more digits"),
        (("query", two_environments, "SELEC 1"), "DuckDB refuses the query"),
        (("query", two_environments, "SELECT lenth FROM records"), "length"),
        (("query", two_environments, f"ATTACH '{nowhere}'"), "one statement that reads"),
        (("export", two_environments, "--out", "/dev/null/x.csv"), "give another --out"),
    ):
        assert message in _refused(capsys, *words)
    assert list(tmp_path.iterdir()) == []


def test_unreadable_and_foreign_files_are_refused(store, table, capsys):
    other, output = store.directory / "other.parquet", store.directory / "export.csv"
    other.write_bytes(b"nothing")
    assert "cannot read" in _refused(capsys, "show", store.directory, "a")
    assert "move it away" in _refused(capsys, "export", store.directory, "--out", output)
    assert [file.suffix for file in store.directory.iterdir()] == [".parquet"] * 2
    metadata = table.schema.metadata | {VERSION_KEY: b"9"}
    pq.write_table(table.replace_schema_metadata(metadata), other)
    assert "schema version 9" in _refused(capsys, "query", store.directory, "SELECT 1")


TEXT = (Path(__file__).parents[2] / "docs" / "reference" / "evidence.md").read_text("utf-8")


def _blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)


def test_examples_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in _blocks("python"):
        exec(compile(block, "docs/reference/evidence.md", "exec"), names)
    assert capsys.readouterr().out.count("(201,)") == 3
    store = open_run("runs/first-look")
    assert store.count() == 11
    assert store.verify() == []


def test_queries_run(two_environments):
    store = open_run(two_environments)
    by_discretization, failures, steps = (store.query(sql) for sql in _blocks("sql"))
    assert by_discretization.to_pylist()[0]["episodes"] == 6
    assert sum(failures.column("episodes").to_pylist()) == 6
    residuals = [abs(x) for x in steps.column("energy_residual").to_pylist()]
    assert residuals == sorted(residuals, reverse=True)
    (expression,) = re.findall(r"`(CAST\(arguments.*?)`", TEXT)
    table = store.query(f"SELECT DISTINCT {expression} AS mass FROM records")
    assert sorted(table.column("mass").to_pylist()) == [0.1, 1.0]


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
