"""``integ-gym evidence``: what it prints, and how it refuses bad input."""

from __future__ import annotations

import contextlib
import csv
import importlib
import io
import json
import os
import pty
import re
import subprocess
import sys
import termios

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from integ_gym.cli import main as run
from integ_gym.evidence.fields import SUMMARY_FIELDS
from integ_gym.evidence.printing import print_table, show, sparkline
from integ_gym.evidence.schema import VERSION_KEY
from integ_gym.evidence.store import open_run


@pytest.fixture
def record_id(two_environments):
    rows = open_run(two_environments).query(
        "SELECT record_id FROM records WHERE env_id = 'IntegPendulum-v0' ORDER BY episode_index"
    )
    return rows.column("record_id")[0].as_py()


def main(argv):
    """Run ``integ-gym evidence``; returns its exit code."""
    return run(["evidence", *argv])


def _refused(capsys, *argv):
    """The one line that a refused command prints."""
    assert main([str(argument) for argument in argv]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("integ-gym evidence: ")
    assert captured.err.count("\n") == 1
    return captured.err


def test_show_prints_every_field_with_its_unit(two_environments, record_id, capsys):
    assert main(["show", str(two_environments), record_id[:10]]) == 0
    text = capsys.readouterr().out
    lines = {line.split()[0]: line for line in text.splitlines() if line.startswith("  ")}
    for field in SUMMARY_FIELDS:
        if field.name != "arguments":
            assert field.name in lines, field.name
    assert lines["record_id"].endswith(record_id)
    assert lines["control_period"].split()[1:] in (["0.05", "s"], ["0.05"])
    assert lines["energy_start"].endswith(" J")
    assert lines["mass"].split() == ["mass", "1", "kg"]
    assert lines["theta_dot"].endswith("rad/s")
    assert lines["torque_applied"].endswith("N m")
    for group in ("identity", "discretization", "policy", "outcome", "replays", "ledger",
                  "solver", "provenance", "trace"):  # fmt: skip
        assert group in text.splitlines()


def test_show_without_a_trace(two_environments, record_id):
    record = open_run(two_environments).find(record_id)
    bare = type(record)(record.fields, {}, record.units, record.frames)
    assert "no trace: trace_every is 1" in show(bare)


def test_show_on_a_terminal_without_unicode(two_environments, record_id):
    done = subprocess.run(
        [sys.executable, "-c",
         f"from integ_gym.commands.evidence import main; "
         f"raise SystemExit(main(['show', {str(two_environments)!r}, {record_id!r}]))"],
        capture_output=True, check=True, env={"PYTHONIOENCODING": "ascii"},
    )  # fmt: skip
    assert b"theta" in done.stdout


def test_sparkline():
    assert sparkline(np.arange(8.0)) == "▁▂▃▄▅▆▇█"
    assert sparkline(np.zeros(5), "ab") == "aaaaa"
    assert len(sparkline(np.arange(1000.0))) == 40


def test_query_table(two_environments, capsys):
    sql = ("SELECT env_id, count(*) AS n, any_value(theta) AS theta FROM records "
           "GROUP BY env_id ORDER BY env_id")  # fmt: skip
    assert main(["query", str(two_environments / "evidence"), sql]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["env_id", "n", "theta"]
    assert lines[2].split()[:2] == ["IntegCartPole-v0", "3"]
    assert lines[3].split() == ["IntegPendulum-v0", "3", "[201", "values]"]
    assert lines[-1] == "(2 rows)"


def _cells(text):
    """Of rows that are printed one column a line: name to cell."""
    return dict(re.split(" {2,}", line, maxsplit=1) for line in text.splitlines()
                if re.match(r"\w+ {2,}\S", line))  # fmt: skip


def test_a_row_of_many_columns_is_printed_one_a_line_with_units(
    two_environments, capsys, monkeypatch
):
    monkeypatch.delenv("COLUMNS", raising=False)
    sql = "SELECT * FROM records ORDER BY record_id LIMIT 1"
    assert main(["query", str(two_environments), sql]) == 0
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines())) <= 120
    cells = _cells(text)
    assert cells["dt"] == "0.05 s" or cells["dt"] == "0.02 s"
    assert re.fullmatch(r"\S+ J", cells["work_total"])
    assert cells["constraint_violation_max"] == "-"
    assert re.fullmatch(r"\d+", cells["length"])
    assert text.count(" ...\n") == 1
    assert text.endswith("--format json gives every value in full.\n(1 row)\n")
    assert main(["query", str(two_environments), sql, "--format", "csv"]) == 0
    (row,) = csv.DictReader(io.StringIO(capsys.readouterr().out))
    assert json.loads(row["arguments"])
    assert float(row["dt"]) in (0.05, 0.02)


def test_many_rows_into_a_file_stay_one_a_line(monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    table = pa.table({f"column_{k}": ["a_word_" + "x" * 20] * 11 for k in range(9)})
    file = io.StringIO()
    print_table(table, file)
    assert len(file.getvalue().splitlines()) == 2 + 11 + 1
    for made, width in ((table.slice(0, 10), ""), (table, "60")):
        monkeypatch.setenv("COLUMNS", width)
        file = io.StringIO()
        print_table(made, file)
        assert len(file.getvalue().splitlines()) == len(made) * 10 + 1


def test_a_unit_is_that_of_the_field_and_not_of_another_column_of_its_name():
    table = pa.table({"dt": [3], "energy_end": [1.5], **{f"x{k}": ["y" * 30] for k in range(9)}})
    file = io.StringIO()
    print_table(table, file)
    cells = _cells(file.getvalue())
    assert (cells["dt"], cells["energy_end"], cells["x0"]) == ("3", "1.5 J", "y" * 30)


def test_query_csv_and_json_give_values_in_full(two_environments, record_id, capsys):
    sql = (
        'SELECT record_id, "return", success, time_to_success, wall_start, initial_state, theta '
        f"FROM records WHERE record_id = '{record_id}'"
    )
    record = open_run(two_environments).find(record_id)
    assert main(["query", str(two_environments), sql, "--format", "json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row["theta"] == record["theta"].tolist()
    assert row["return"] == record["return"]
    assert row["wall_start"] == record["wall_start"].isoformat()
    assert row["time_to_success"] is None
    assert main(["query", str(two_environments), sql, "--format", "csv"]) == 0
    (row,) = csv.DictReader(io.StringIO(capsys.readouterr().out))
    assert json.loads(row["theta"]) == record["theta"].tolist()
    assert float(row["return"]) == record["return"]
    assert row["time_to_success"] == ""


def test_print_table_of_odd_values():
    table = pa.table({"a": [float("nan"), None], "b": ["x" * 100, ""], "c": [[1.0], [2.0] * 9]})
    file = io.StringIO()
    print_table(table, file, "json")
    assert json.loads(file.getvalue())[0]["a"] is None
    file = io.StringIO()
    print_table(table, file)
    assert "x" * 100 in file.getvalue()
    with pytest.raises(ValueError, match="must be one of table, csv, json"):
        print_table(table, file, "xml")


def test_verify(two_environments, capsys, store):
    assert main(["verify", str(two_environments)]) == 0
    assert "records: 6, files: 2" in capsys.readouterr().out
    file = store.files()[0]
    table = pq.read_table(file)
    index = table.schema.get_field_index("success")
    pq.write_table(table.set_column(index, table.schema.field(index), [[True] * 3]), file)
    assert main(["verify", str(store.directory)]) == 1
    text = capsys.readouterr().out
    assert text.count("was altered") == 3
    assert "problems in" in text


def test_verify_says_meanwhile_what_it_checks_and_how_much_is_done(two_environments, capsys):
    assert main(["verify", str(two_environments)]) == 0
    shown = capsys.readouterr().err
    phases = ["hashes", "outcomes from traces", "plan and verdicts", "seal", "playing again"]
    places = [shown.index(phase) for phase in phases]
    assert places == sorted(places)
    assert re.search(r" [1-9]\d?%.*outcomes from traces", shown)
    assert "100%" in shown
    assert main(["verify", str(two_environments), "--no-progress"]) == 0
    assert capsys.readouterr().err == ""


def test_export(two_environments, tmp_path, capsys):
    assert main(["export", str(two_environments)]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert len(rows) == 6
    assert list(rows[0]) == [field.name for field in SUMMARY_FIELDS]
    assert len(json.loads(rows[0]["initial_state"])) == 4
    output = tmp_path / "records.jsonl"
    argv = ["export", str(two_environments), "--to", "jsonl", "--out", str(output)]
    assert main(argv) == 0
    lines = [json.loads(line) for line in output.read_text(encoding="utf-8").splitlines()]
    records = {record["record_id"]: record for record in open_run(two_environments).records()}
    assert {line["record_id"] for line in lines} == set(records)
    for line in lines:
        assert line == records[line["record_id"]].summary()
        assert list(line) == [field.name for field in SUMMARY_FIELDS]


def _table(width, *argv):
    """What a real terminal of that width is shown."""
    master, terminal = pty.openpty()
    termios.tcsetwinsize(terminal, (24, width))
    command = [sys.executable, "-m", "integ_gym.cli", "evidence", *map(str, argv)]
    with subprocess.Popen(command, stdout=terminal) as process:
        os.close(terminal)
        shown = b""
        with contextlib.suppress(OSError):  # Linux's word for the end of a terminal's output
            while part := os.read(master, 65536):
                shown += part
    os.close(master)
    assert process.returncode == 0
    return shown.decode().splitlines()


@pytest.mark.parametrize("selected", ["record_id, metric_definition", "*"])
def test_a_query_fits_the_terminal_and_nothing_is_cut(two_environments, selected):
    sql = f"SELECT {selected} FROM records ORDER BY record_id LIMIT 2"
    goals = open_run(two_environments).query(sql).column("metric_definition").to_pylist()
    lines = _table(80, "query", two_environments, sql)
    assert max(map(len, lines)) <= 80
    words = "".join(lines).replace(" ", "")
    assert all(goal.replace(" ", "") in words for goal in goals)
    assert lines[-1] == "(2 rows)"


def test_a_record_fits_the_terminal_and_nothing_is_cut(two_environments, record_id, capsys):
    assert main(["show", str(two_environments), record_id]) == 0
    piped = capsys.readouterr().out
    lines = _table(80, "show", two_environments, record_id)
    assert max(map(len, lines)) <= 80
    assert sorted("".join(lines).replace(" ", "")) == sorted("".join(piped.split()))


def test_a_reader_that_stops_amid_many_records_is_no_error(two_environments):
    sql = "SELECT unnest(theta), unnest(time) FROM records, range(500)"
    for given in (["--format", "csv"], ["--format", "table"]):
        query = ["evidence", "query", str(two_environments), sql, *given]
        with subprocess.Popen(
            [sys.executable, "-m", "integ_gym.cli", *query],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        ) as process:  # fmt: skip
            assert process.stdout is not None
            assert process.stderr is not None
            process.stdout.readline()
            process.stdout.close()
            assert process.stderr.read() == b""
            assert process.wait() == 0


def test_bad_input_is_refused_with_one_sentence(two_environments, tmp_path, record_id, capsys):
    nowhere = tmp_path / "nowhere"
    assert f"no directory {nowhere}" in _refused(capsys, "show", nowhere, "a")
    assert "holds no evidence" in _refused(capsys, "query", tmp_path, "SELECT 1")
    assert "no record 'zz'" in _refused(capsys, "show", two_environments, "zz")
    assert "give more digits" in _refused(capsys, "show", two_environments, "")
    error = _refused(capsys, "query", two_environments, "SELEC 1")
    assert "DuckDB refuses the query" in error
    error = _refused(capsys, "query", two_environments, "SELECT lenth FROM records")
    assert "length" in error
    for sql in (
        f"COPY records TO '{tmp_path / 'x.csv'}'",
        f"SELECT 1; COPY records TO '{tmp_path / 'x.csv'}'",
        f"EXPLAIN ANALYZE COPY records TO '{tmp_path / 'x.csv'}'",
        f"ATTACH '{tmp_path / 'x.db'}'",
        "",
    ):
        assert "one statement that reads" in _refused(capsys, "query", two_environments, sql)
    assert list(tmp_path.iterdir()) == []
    nowhere.write_text("")
    error = _refused(capsys, "export", two_environments, "--out", nowhere / "x.csv")
    assert "give another --out" in error


def test_unreadable_and_foreign_files_are_refused(store, capsys):
    table = pq.read_table(store.files()[0])
    other = store.directory / "other.parquet"
    other.write_bytes(b"nothing")
    assert "cannot read" in _refused(capsys, "show", store.directory, "a")
    output = store.directory / "export.csv"
    assert "move it away" in _refused(capsys, "export", store.directory, "--out", output)
    assert [file.suffix for file in store.directory.iterdir()] == [".parquet"] * 2
    metadata = table.schema.metadata | {VERSION_KEY: b"9"}
    pq.write_table(table.replace_schema_metadata(metadata), other)
    error = _refused(capsys, "query", store.directory, "SELECT 1")
    assert "schema version 9" in error
    assert "the version that wrote it" in error


@pytest.mark.parametrize("package", ["pyarrow", "duckdb"])
def test_missing_extra_is_named(two_environments, monkeypatch, capsys, package):
    found = importlib.import_module

    def without(name, *rest):
        if name.partition(".")[0] == package:
            raise ModuleNotFoundError(f"No module named {name!r}", name=package)
        return found(name, *rest)

    monkeypatch.setattr(importlib, "import_module", without)
    error = _refused(capsys, "query", two_environments, "SELECT 1")
    assert 'pip install -e ".[evidence]"' in error


@pytest.mark.parametrize("argv", [[], ["shw"], ["query", "run"], ["export", "x", "--to", "x"]])
def test_wrong_usage(argv, capsys):
    with pytest.raises(SystemExit) as ended:
        main(argv)
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert error.startswith("integ-gym evidence")
    assert error.endswith("--help\n")
    assert error.count("\n") == 1
