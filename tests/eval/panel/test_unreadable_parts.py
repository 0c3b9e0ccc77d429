"""What cannot be read is a finding, never a traceback, and hides no other finding."""

from __future__ import annotations

import hashlib
import json
import shutil

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from integ_gym.cli import main
from integ_gym.evidence.hashing import with_hashes
from integ_gym.evidence.sealing import seal

COLUMNS = (
    *("perturbation", "training_discretization", "arguments", "engine_description"),
    "package_versions",
)
TEXTS = ("{", "7", "[7]", '{"mass":[]}')


@pytest.fixture
def run(panel_directory, tmp_path):
    return shutil.copytree(panel_directory, tmp_path / "run")


def _rewrite(run, change):
    """Change the rows of an evaluation, with hashes, marker and seal that fit."""
    file = next(run.glob("evidence/evaluate-*.parquet"))
    table = pq.read_table(file)
    rows = table.to_pylist()
    change(rows)
    made = pa.Table.from_pylist(rows, table.schema)
    pq.write_table(with_hashes(made.combine_chunks()), file)
    _mark(run, file, lambda held: None)


def _mark(run, file, change):
    marker = run / "units" / f"{file.stem}.json"
    held = json.loads(marker.read_text())
    held["records"] = hashlib.sha256(file.read_bytes()).hexdigest()
    change(held)
    marker.write_text(json.dumps(held))
    seal(run)


@pytest.mark.parametrize("text", TEXTS)
@pytest.mark.parametrize("column", COLUMNS[:2])
def test_json_of_a_record_that_is_none_is_found_with_all_else(run, column, text, capsys):
    touched = []

    def change(rows):
        judged = [row for row in rows if row["phase"] == "evaluation"]
        traced = [row for row in judged if row["reward"] is not None]
        first, second = traced[0], traced[-1]
        first[column] = text
        second["return"] += 1.0
        touched.extend((first["policy_id"], second["record_id"]))

    _rewrite(run, change)
    assert main(["evidence", "verify", str(run), "--all"]) == 1
    told = capsys.readouterr().out
    assert f"`{column}`" in told
    assert touched[0] in told
    assert f"{touched[1]}: `return` is recorded as" in told
    assert main(["report", str(run)]) == 2
    assert capsys.readouterr().err.count("\n") <= 4


def _other_key(held):
    held["key"] = 7


def _other_policies(held):
    held["policies"] = dict.fromkeys(held["policies"], 7)


def _other_cells(held):
    held["cells"] = {policy: [[]] for policy in held["cells"]}


@pytest.mark.parametrize("change", [_other_key, _other_policies, _other_cells])
def test_a_marker_of_another_form_is_found_with_all_else(run, change, capsys):
    _rewrite(run, lambda rows: rows[0].update({"success": not rows[0]["success"]}))
    file = next(run.glob("evidence/evaluate-*.parquet"))
    _mark(run, file, change)
    policy = next(run.glob("policies/*"))
    (policy / "policy.json").write_text("{")
    seal(run)
    assert main(["evidence", "verify", str(run)]) == 1
    told = capsys.readouterr().out
    assert f"units/{file.stem}.json" in told
    assert f"policies/{policy.name}" in told
    assert "`success` is recorded as" in told


def test_a_manifest_of_another_form_is_found_with_all_else(run, capsys):
    _rewrite(run, lambda rows: rows[0].update({"success": not rows[0]["success"]}))
    (run / "run.json").write_text('{"specification": 7, "versions": {}}')
    seal(run)
    assert main(["evidence", "verify", str(run)]) == 1
    told = capsys.readouterr().out
    assert "run.json" in told
    assert "`success` is recorded as" in told
