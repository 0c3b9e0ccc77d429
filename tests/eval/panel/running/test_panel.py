"""The panel end to end: what it writes, resuming, refusals."""

import json
import platform
import shutil
from pathlib import Path

import numpy as np
import portalocker
import pytest
from small_panel import TOML

from integ_gym.cli import main
from integ_gym.eval.panel.result import read_panel
from integ_gym.eval.panel.spec import read_spec
from integ_gym.evidence.store import EvidenceStore


def _panel(directory: Path) -> dict:
    return json.loads((directory / "panel.json").read_text(encoding="utf-8"))


def test_nothing_tells_of_the_machine_but_its_kind(panel_directory):
    """Neither where the run lies nor the kernel."""
    files = [f for f in panel_directory.rglob("*") if f.suffix in (".json", ".html")]
    assert len(files) > 10
    for file in files:
        text = file.read_text(encoding="utf-8")
        assert str(panel_directory.parents[1]) not in text, file
        assert platform.release() not in text, file


def test_every_cell_has_every_paired_episode_once(panel_directory):
    spec = read_spec(panel_directory.parent / "small.toml")
    store = EvidenceStore(panel_directory / "evidence")
    found = store.query(
        "SELECT policy_id, cell, count(*) AS n, count(DISTINCT episode_index) AS k, "
        "list(initial_state ORDER BY episode_index) AS starts FROM records "
        "WHERE phase = 'evaluation' GROUP BY policy_id, cell"
    ).to_pylist()
    rows = len(spec.baselines) * len(spec.cells_of(None))
    rows += len(spec.seeds) * sum(len(spec.cells_of(home)) for home in spec.train)
    assert len(found) == rows
    assert {(row["n"], row["k"]) for row in found} == {(spec.episodes, spec.episodes)}
    starts = {}
    for row in found:
        starts.setdefault(row["policy_id"], set()).add(json.dumps(row["starts"]))
    assert {len(own) for own in starts.values()} == {1}, "paired between cells"
    assert len({json.dumps(sorted(own)) for own in starts.values()}) == len(spec.seeds)
    assert store.verify() == []


def test_training_episodes_are_recorded_and_some_have_traces(panel_directory):
    store = EvidenceStore(panel_directory / "evidence")
    (row,) = store.query(
        "SELECT count(*) AS n, sum((len(theta) > 0)::INT) AS traced FROM records "
        "WHERE phase = 'training'"
    ).to_pylist()
    assert row["n"] > row["traced"] > 0
    (row,) = store.query(
        "SELECT count(*) AS n, sum((len(theta) > 0)::INT) AS traced FROM records "
        "WHERE phase = 'evaluation'"
    ).to_pylist()
    assert row["n"] == row["traced"] > 0


def test_matrix_is_what_the_records_say(panel_directory):
    panel = _panel(panel_directory)
    store = EvidenceStore(panel_directory / "evidence")
    for entry in panel["matrix"]:
        row = next(r for r in panel["rows"] if r["name"] == entry["row"])
        ids = ", ".join(f"'{policy['id']}'" for policy in row["policies"])
        (truth,) = store.query(
            'SELECT avg(success::INT) AS success, avg("return") AS mean_return, count(*) AS n '
            "FROM records WHERE phase = 'evaluation' "
            f"AND cell = '{entry['cell']}' AND policy_id IN ({ids})"
        ).to_pylist()
        assert entry["success"]["estimate"] == pytest.approx(truth["success"])
        assert entry["episodes"] == truth["n"]
        assert sum(entry["labels"].values()) == truth["n"]
        assert entry["success"]["low"] < entry["success"]["high"]
        assert entry["return"] is None or np.isfinite(entry["return"]["estimate"])


def test_gaps_and_classes_are_given_where_they_are_defined(panel_directory):
    panel = _panel(panel_directory)
    entries = {(e["row"], e["cell"]): e for e in panel["matrix"]}
    home = entries["rk4 dt=0.05", "rk4 dt=0.05"]
    assert (home["home_drop"], home["transfer_gap"]) == (None, None)
    away = entries["rk4 dt=0.05", "explicit_euler dt=0.05"]
    assert away["home_drop"] is not None
    assert away["transfer_gap"] is not None
    untrained = entries["rk4 dt=0.05", "rk4 dt=0.0125"]
    assert untrained["home_drop"] is not None
    assert untrained["transfer_gap"] is None
    assert untrained["reference_class"] in ("true_pass", "false_pass", "false_fail", "true_fail")
    assert entries["handmade", "reference dt=0.05"]["home_drop"] is None
    (verdict,) = panel["verdicts"]
    assert verdict["verdict"] in ("inconclusive", "not_learned")
    (comparison,) = panel["policy_comparisons"]
    assert comparison["outcome"] in ("accepted", "rejected", "uninformative")
    assert read_panel(panel_directory / "panel.json").answer.startswith("Not answered: ")


@pytest.mark.parametrize("lost", ["report.html", "panel.json"])
def test_what_a_complete_run_lacks_is_written_and_nothing_redone(run, again, lost):
    cost = _panel(run)["cost"]
    assert 0 < cost["train_seconds"] < 2 * cost["wall_seconds"]
    (run / lost).unlink()
    files = {
        path: path.stat().st_mtime_ns
        for folder in ("evidence", "policies", "units")
        for path in (run / folder).rglob("*")
    }
    assert again(run) == 0
    assert (run / lost).exists()
    assert files == {path: path.stat().st_mtime_ns for path in files}
    assert _panel(run)["cost"] == cost


def _fails(capsys, *arguments: str) -> str:
    """The one line that a command ends with on bad input."""
    assert main(list(arguments)) == 2
    error = capsys.readouterr().err.strip()
    assert error.count("\n") == 0
    assert error.startswith("integ-gym ")
    return error


def test_another_versions_results_are_refused(run, again, capsys):
    manifest = json.loads((run / "run.json").read_text())
    manifest["versions"]["integ-gym"] = "0.0.1"
    (run / "run.json").write_text(json.dumps(manifest))
    assert again(run) == 2
    message = capsys.readouterr().err
    assert "integ-gym 0.0.1 (now" in message
    assert "never mixed" in message


def test_a_directory_with_other_files_is_refused(tmp_path, capsys):
    (tmp_path / "thesis.tex").write_text("mine")
    message = _fails(capsys, "panel", "--out", str(tmp_path))
    assert "holds no panel" in message
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize(
    ("old", "new", "fragment"),
    [
        ("dt = 0.05\n\n[[eval", "dt = nan\n\n[[eval", "> 0.0 - at `train[0].dt`"),
        ("episodes = 3", "episoden = 3", "episodes"),
    ],
)  # fmt: skip
def test_bad_specifications_leave_nothing_behind(tmp_path, capsys, old, new, fragment):
    spec = tmp_path / "bad.toml"
    assert old in TOML
    spec.write_text(TOML.replace(old, new), encoding="utf-8")
    message = _fails(capsys, "panel", str(spec), "--out", str(tmp_path / "out"))
    assert fragment in message
    assert not (tmp_path / "out").exists()


def test_two_runs_in_one_directory_are_refused(run, again, capsys):
    with (run / ".lock").open("w") as lock:
        portalocker.lock(lock, portalocker.LockFlags.EXCLUSIVE)
        assert again(run) == 2
    assert "another process" in capsys.readouterr().err


def test_report_is_written_again(run, capsys):
    page = run / "report.html"
    before = page.read_text(encoding="utf-8")
    page.unlink()
    assert main(["report", str(run)]) == 0
    assert str(page) in capsys.readouterr().out
    assert page.read_text(encoding="utf-8").replace(str(run), "") == before.replace(str(run), "")
    folder = page.parent.parent
    assert "holds no panel; give the directory" in _fails(capsys, "report", str(folder))
    assert "there is no directory" in _fails(capsys, "report", str(folder / "other"))


@pytest.mark.slow
def test_what_was_lost_is_done_again_by_any_number_of_workers(panel_directory, tmp_path):
    """Records without a marker too, which a kill between the two leaves: divided anew."""
    copy = tmp_path / "copy"
    shutil.copytree(panel_directory, copy)
    lost = [
        copy / "evidence" / "train-rk4-dt-0.05-seed0.parquet",
        copy / "policies" / "rk4-dt-0.05-seed1" / "policy.zip",
    ]
    markers = sorted((copy / "units").glob("evaluate-*.json"))
    for file in [*lost, markers[0]]:
        file.unlink()
    kept = {file: file.stat().st_mtime_ns for file in markers[1:]}
    assert kept
    command = ["panel", str(panel_directory.parent / "small.toml"), "--out", str(copy)]
    assert main([*command, "--workers", "3", "--no-progress"]) == 0
    assert all(file.exists() for file in lost)
    assert kept == {file: file.stat().st_mtime_ns for file in kept}
    assert len(list((copy / "units").glob("evaluate-*.json"))) > len(markers)
    _assert_same_records(copy, panel_directory)


def _assert_same_records(directory: Path, other: Path) -> None:
    """Every evaluation record is there once, and the same in both."""
    query = "SELECT record_id, content_hash FROM records WHERE phase = 'evaluation' ORDER BY 1"
    stores = [EvidenceStore(folder / "evidence") for folder in (directory, other)]
    found, expected = (store.query(query).to_pylist() for store in stores)
    assert found == expected
    assert stores[0].verify() == []


def test_an_evaluation_of_another_policy_is_refused(run, again, capsys):
    marker = next((run / "units").glob("evaluate-*.json"))
    content = json.loads(marker.read_text())
    marker.write_text(json.dumps(content | {"key": "0" * 16}))
    assert again(run) == 2
    assert "was changed after the run was sealed; restore it" in capsys.readouterr().err
    (run / "seal.json").unlink()
    assert again(run) == 2
    assert "belongs to another specification, version or policy" in capsys.readouterr().err


def test_a_panel_file_without_its_plan_is_refused(tmp_path, capsys):
    content = {"schema_version": 7, "rows": [1], "matrix": [{}], "cells": []}
    (tmp_path / "panel.json").write_text(json.dumps(content))
    message = _fails(capsys, "report", str(tmp_path))
    assert "run.json: is missing, which says what was planned" in message


def test_failures_are_labelled_with_the_replays_that_the_panel_has(panel_directory):
    store = EvidenceStore(panel_directory / "evidence")
    labels = store.query(
        "SELECT DISTINCT failure_label FROM records WHERE phase = 'evaluation' AND NOT success"
    ).to_pylist()
    assert labels
    assert "unattributed" not in {row["failure_label"] for row in labels}
