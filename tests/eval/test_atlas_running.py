"""An atlas from its specification to its summaries, and begun again."""

from __future__ import annotations

import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import msgspec
import pyarrow as pa
import pytest
from house import ROOT
from small_atlas import written

from integ_gym.cli import main
from integ_gym.eval.atlas.running import missing
from integ_gym.eval.atlas.specification import read_atlas
from integ_gym.eval.atlas.summaries import read_summary, write_summary
from integ_gym.evidence.sealing import read_seal

_THREADS_OF_READING = """
import os, sys
from pathlib import Path
import pyarrow.parquet
from integ_gym.eval.atlas.summaries import read_summary
def threads(): return len(os.listdir("/proc/self/task"))
before = threads()
assert read_summary(Path(sys.argv[1])).rows.num_rows
print(threads() - before)
"""


def _run(spec, out, *more):
    return main(["atlas", str(spec), "--out", str(out), "--workers", "1", *more])


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Both blocks of a small atlas."""
    folder = tmp_path_factory.mktemp("atlas")
    spec = written(folder, seeds_per_block="seeds_per_block = 2")
    assert _run(spec, folder / "runs", "--no-progress") == 0
    return folder


@pytest.mark.slow
def test_a_summary_has_a_row_for_every_policy_and_cell(run):
    atlas = read_atlas(run / "small.toml")
    for block in atlas.blocks():
        summary = read_summary(run / "runs" / "summaries" / f"{block.name}.parquet")
        rows = summary.rows.to_pylist()
        homes = {home.name for home in block.panel.train}
        cells = {cell.name for cell in block.panel.columns()}
        assert {(row["home"], row["cell"]) for row in rows} == {
            (h, c) for h in homes for c in cells
        }
        assert {row["seed"] for row in rows} == set(block.panel.seeds)
        assert all(row["episodes"] == 2 >= row["recovered"] >= row["successes"] for row in rows)
        assert all(len(row["policy_hash"]) == 32 for row in rows)
        assert summary.origin.seal == read_seal(run / "runs" / block.name)["seal"]
        assert summary.origin.limit == block.limit


@pytest.mark.slow
def test_what_has_a_summary_is_not_run_again_even_without_its_evidence(run, capsys):
    out, spec = run / "elsewhere", run / "small.toml"
    shutil.copytree(run / "runs" / "summaries", out / "summaries")
    assert _run(spec, out, "--no-progress") == 0
    assert [path.name for path in out.iterdir()] == ["summaries"]
    assert "2 of 2 blocks" in capsys.readouterr().out
    (out / "summaries" / "3-seed3.parquet").unlink()
    assert [block.name for block in missing(read_atlas(spec), out / "summaries")] == ["3-seed3"]


@pytest.mark.slow
def test_a_block_run_again_agrees(run, capsys):
    assert _run(run / "small.toml", run / "runs", "--again", "3-seed3") == 0
    told = capsys.readouterr().out
    assert "4 policies trained again in 3-seed3: all 8 outcomes are the same." in told
    assert (run / "runs" / "summaries" / "agreements.json").exists()


@pytest.mark.slow
def test_where_the_first_seeds_differ_the_whole_block_is_run_again(run, tmp_path, capsys):
    path = tmp_path / "3-seed3.parquet"
    given = (run / "small.toml", run / "runs", "--again", "3-seed3", "--summaries", str(tmp_path))
    summary = read_summary(run / "runs" / "summaries" / path.name)
    assert summary.origin.instruction_sets
    rows = [{**row, "policy_hash": bytes(32)} for row in summary.rows.to_pylist()]
    here = replace(summary, rows=pa.Table.from_pylist(rows))
    write_summary(here, path)
    assert _run(*given) == 2
    assert "policy_hash differ between code" in capsys.readouterr().err
    origin = msgspec.structs.replace(summary.origin, instruction_sets=("another",))
    write_summary(replace(here, origin=origin), path)
    assert _run(*given) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "4 policies trained again in 3-seed3: other weights" in told
    assert "mean success differs by 0.000" in told


@pytest.mark.slow
def test_summaries_of_another_specification_are_refused(run, tmp_path, capsys):
    spec = written(tmp_path, total_steps="total_steps = 1024")
    assert _run(spec, run / "runs") == 2
    assert "is of another specification than block 1.5-seed3" in capsys.readouterr().err


def test_a_plan_runs_nothing(tmp_path, capsys):
    spec = written(tmp_path)
    assert _run(spec, tmp_path / "runs", "--plan") == 0
    told = capsys.readouterr().out
    assert "4 blocks missing" in told
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("extra", [["--only", "9-seed1"], ["--again", "9-seed1"]])
def test_a_block_that_is_none_is_refused(tmp_path, capsys, extra):
    assert _run(written(tmp_path), tmp_path / "runs", *extra) == 2
    assert "there is no block '9-seed1'; --plan lists them" in capsys.readouterr().err


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="threads are counted by Linux")
def test_reading_a_summary_leaves_no_thread_that_could_abort_the_end():
    path = ROOT / "docs" / "atlas" / "rod_pendulum" / "3-seed2000.parquet"
    command = [sys.executable, "-c", _THREADS_OF_READING, str(path)]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "0\n"
