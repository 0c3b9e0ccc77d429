"""Blocks of an atlas, summaries that may be combined, and what is published of them."""

from __future__ import annotations

import csv
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import msgspec
import pyarrow as pa
import pytest
from house import ROOT
from hypothesis import given, settings
from hypothesis import strategies as st
from small_atlas import written
from small_panel import every_format

from integ_gym.cli import main
from integ_gym.envs.settings import Discretization
from integ_gym.eval.atlas.running import finished, missing, publish, summary_path
from integ_gym.eval.atlas.specification import (
    critical_limit,
    read_atlas,
)
from integ_gym.eval.atlas.summaries import (
    Agreement,
    Origin,
    Summary,
    _bare,
    check_agree,
    code_version,
    compare,
    note,
    read_agreements,
    read_summary,
    write_summary,
)
from integ_gym.eval.panel.cells import SpecError
from integ_gym.evidence.sealing import read_seal


def test_blocks_are_every_ratio_with_the_first_seeds_then_with_the_next(tmp_path):
    atlas = read_atlas(written(tmp_path))
    blocks = atlas.blocks()
    assert [block.name for block in blocks] == ["1.5-seed3", "3-seed3", "1.5-seed4", "3-seed4"]
    assert [block.panel.seeds for block in blocks] == [(3,), (3,), (4,), (4,)]
    for block in blocks:
        assert block.limit == pytest.approx(block.ratio * atlas.critical, abs=5e-5)
        assert block.panel.environment["max_torque"] == block.limit
        assert block.panel.environment["duration"] == 3.0
    stated = written(tmp_path, seeds_per_block="seeds_per_block = 1\ncritical = 0.25")
    assert [block.limit for block in read_atlas(stated).blocks()[:2]] == [0.375, 0.75]


def test_the_critical_torque_lifts_and_less_does_not():
    """Of the rod within 10 s: 0.420 N m, on the truth and where the map is nearly exact."""
    given = {"start": "hanging", "duration": 10.0}
    truth = Discretization("reference", 0.05, 0.05)
    assert critical_limit("IntegPendulum-v0", given, "max_torque", truth) == pytest.approx(
        0.4202, abs=2e-4
    )
    pumping = Discretization("explicit_euler", 0.05, 0.05)
    assert critical_limit("IntegPendulum-v0", given, "max_torque", pumping) < 0.1


@pytest.mark.parametrize(
    ("key", "line", "message"),
    [
        ("ratios", "ratios = [3.0, 1.5]", "`ratios` must be above 0 and ascend"),
        ("ratios", "ratios = []", "`ratios` must be above 0 and ascend"),
        ("argument", 'argumnt = "max_torque"', "required field `argument`|unknown field"),
        ("seeds_per_block", "seeds_per_block = 0", "`seeds_per_block` must be 1 or above"),
        ("argument", 'argument = "max_speed"', "`max_speed` does not limit the control"),
        ("name", 'name = "x"', "has no table"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(tmp_path, key, line, message):
    path = written(tmp_path, **{key: line})
    if key == "name":
        path.write_text(path.read_text().replace("[atlas]", "[other]"), encoding="utf-8")
    with pytest.raises(SpecError, match=message) as caught:
        read_atlas(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_rows_of_another_control_period_are_refused(tmp_path):
    path = written(tmp_path)
    place = 'integrator = "rk4"\ndt = 0.05'
    row, judged = (f"{place}\ncontrol_period = {period}" for period in (0.1, [0.05, 0.1]))
    text = path.read_text(encoding="utf-8").replace(place, row, 1)
    path.write_text(
        text.replace(f"[[evaluate]]\n{place}", f"[[evaluate]]\n{judged}"), encoding="utf-8"
    )
    with pytest.raises(SpecError, match="an atlas has one control period"):
        read_atlas(path)


ROWS = [
    {
        "home": "rk4 dt=0.05",
        "seed": seed,
        "cell": cell,
        "episodes": 10,
        "successes": 2,
        "policy_hash": b"p",
    }
    for seed in (3, 4)
    for cell in ("rk4 dt=0.05", "reference dt=0.05")
]


def summary(code, rows=ROWS, instruction_sets=()):
    origin = Origin(
        atlas="a", ratio=1.5, limit=0.6, seal="s", weights="w", code=code, versions={},
        specification={}, cost={}, instruction_sets=instruction_sets,
    )  # fmt: skip
    return Summary(origin, pa.Table.from_pylist(rows))


def test_equal_outcomes_agree():
    found = compare("1.5-seed3", summary("one"), summary("two", ROWS[:2]))
    assert found == Agreement(("one", "two"), "1.5-seed3", policies=1, rows=2)


@pytest.mark.parametrize(("key", "value"), [("successes", 1), ("policy_hash", b"q")])
def test_an_outcome_that_differs_is_named(key, value):
    again = [{**ROWS[0], key: value}]
    with pytest.raises(ValueError, match=f"seed 3 of rk4 dt=0.05 .* {key} differ between code one"):
        compare("1.5-seed3", summary("one"), summary("two", again))


def block(change):
    """Rows of 16 seeds on two training grounds; successes as `change` says of (home, seed)."""
    return [
        {**ROWS[0], "home": home, "seed": seed, "successes": 5 + change(home == "mixture", seed)}
        for home in ("rk4 dt=0.05", "mixture")
        for seed in range(16)
    ]


BEFORE = block(lambda mixed, seed: 0)


def test_a_block_of_another_processor_agrees_where_it_differs_by_chance():
    """And of the same processor nothing is chance."""
    after = block(lambda mixed, seed: mixed * (-1) ** seed)
    found = compare("b", summary("one", BEFORE), summary("two", after))
    assert found.difference is not None
    mean, low, high = found.difference
    assert mean == pytest.approx(0.0, abs=1e-12)
    assert -0.05 < low < 0.0 < high < 0.05
    first, second = (summary(code, rows, ("AVX2",)) for code, rows in (("a", BEFORE), ("b", after)))
    with pytest.raises(ValueError, match=r"seed 0 of mixture .* differ between code a and b"):
        compare("b", first, second)


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        (block(lambda mixed, seed: mixed * (1 + seed % 2)), "success of mixture differs"),
        (block(lambda mixed, seed: 3 * (-1) ** seed), "success may differ"),
        ([{**ROWS[0], "seed": 99}], "seed 99"),
    ],
)
def test_a_block_that_differs_by_more_or_has_other_policies_is_refused(rows, told):
    with pytest.raises(ValueError, match=told):
        compare("b", summary("one", BEFORE), summary("two", rows))


def test_agreements_are_kept_once(tmp_path):
    first = Agreement(("one", "two"), "b", 1, 2)
    for agreement in (first, Agreement(("two", "three"), "b", 1, 2), first):
        note(agreement, tmp_path)
    assert sorted(one.codes for one in read_agreements(tmp_path)) == [
        ("one", "two"),
        ("two", "three"),
    ]


@settings(max_examples=40)
@given(st.lists(st.tuples(st.sampled_from("abcde"), st.sampled_from("abcde")), max_size=8))
def test_only_versions_that_agreements_connect_are_combined(pairs):
    agreements = [Agreement(pair, "b", 1, 1) for pair in pairs]
    groups = {code: {code} for code in "abcde"}
    for first, second in pairs:
        joined = groups[first] | groups[second]
        groups.update(dict.fromkeys(joined, joined))
    if len(groups["a"]) == 5:
        check_agree([summary(code) for code in "abcde"], agreements)
    else:
        with pytest.raises(ValueError, match="never compared"):
            check_agree([summary(code) for code in "abcde"], agreements)


def test_code_is_the_same_whatever_its_docstrings_say():
    assert len(code_version()) == 16
    same = '"""A."""\ndef f(x):\n    """B."""\n    return x  # c\n', "def f(x):\n    return x\n"
    assert _bare(same[0]) == _bare(same[1]) != _bare("def f(x):\n    return -x\n")


def planted(folder, at_home=2):
    """An atlas of two episodes a seed: so many succeed at home, and of RK4's one on the truth."""
    atlas = read_atlas(written(folder))
    for block in atlas.blocks():
        rows = [
            {
                "home": home.name, "seed": seed, "cell": cell.name, "episodes": 2,
                "successes": at_home if cell.name == home.name else 1, "recovered": 2,
            }
            for home in block.panel.train
            for seed in block.panel.seeds
            for cell in block.panel.columns()
        ]  # fmt: skip
        origin = Origin(
            atlas=atlas.name, ratio=block.ratio, limit=block.limit, seal=block.name, weights="",
            code="one", versions={}, specification=block.panel.to_json(), cost={},
        )  # fmt: skip
        write_summary(Summary(origin, pa.Table.from_pylist(rows)), summary_path(folder, block))
    return atlas


def _losses(folder):
    with (folder / "losses.csv").open(encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines))


def test_the_map_is_written_with_every_loss_and_its_interval(tmp_path):
    out = tmp_path / "out"
    with every_format():
        files = publish(planted(tmp_path), tmp_path, out)
    names = ["losses.csv", "phases.pdf", "phases.png", "phases.svg", "tables.md"]
    assert sorted(file.name for file in files) == names
    assert sorted(out.iterdir()) == sorted(files)
    table = (out / "tables.md").read_text(encoding="utf-8").splitlines()
    assert table[0] == "| trained on | 1.5 | 3 |"
    assert table[2].startswith("| rk4 dt=0.05 | 0.50 (")
    losses = _losses(out)
    assert len(losses) == 4
    for row in losses:
        kept = float(row["success on the truth"])
        assert float(row["loss"]) == pytest.approx(float(row["success at home"]) - kept, abs=1e-3)
        assert float(row["loss low"]) < float(row["loss"]) < float(row["loss high"]) + 1e-9
        assert float(row["within twice the time"]) == 1.0
        assert int(row["seeds"]) == 2
    publish(planted(tmp_path, at_home=0), tmp_path, out)
    assert _losses(out) == []  # where nothing was learned nothing is lost


SUMMARIES = sorted(path.parent for path in (ROOT / "docs" / "atlas").glob("*/figures"))


@pytest.mark.slow
@pytest.mark.parametrize("folder", SUMMARIES, ids=lambda folder: folder.name)
def test_figures_and_tables_come_from_the_summaries(folder, tmp_path):
    atlas = read_atlas(ROOT / "specs" / "atlas" / f"{folder.name}.toml")
    there = {f"{block.name}.parquet" for block, _ in finished(atlas, folder)}
    assert there == {file.name for file in folder.glob("*.parquet")}
    publish(atlas, folder, tmp_path)
    pictures = {f"phases.{kind}" for kind in ("png", "svg", "pdf")}
    texts = {"tables.md", "losses.csv"}
    assert {file.name for file in (folder / "figures").iterdir()} == texts | pictures
    for name in texts:
        assert (tmp_path / name).read_bytes() == (folder / "figures" / name).read_bytes()


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
