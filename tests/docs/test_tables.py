"""Pages of published experiments: their tables come from the published rows by the command."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys

import pyarrow.parquet as pq
import pytest
from house import ROOT

PAGES = {"learned_periods": ROOT / "docs" / "explanation" / "control_periods.md"}
FOLDERS = ROOT / "docs" / "tables"


@pytest.fixture
def experiment(request, monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks" / "tables"))
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    yield request.param, importlib.import_module(request.param)
    for name in [one for one in sys.modules if one.split(".")[0] in (request.param, "measuring")]:
        del sys.modules[name]


@pytest.mark.parametrize("experiment", PAGES, indirect=True)
def test_a_page_shows_what_the_rows_come_to_and_nothing_else(experiment):
    name, module = experiment
    rows = pq.read_table(FOLDERS / name / "rows.parquet").to_pylist()
    page = PAGES[name].read_text(encoding="utf-8")
    for part in module.tables(rows).strip().split("\n\n"):
        assert part in page


@pytest.mark.parametrize("experiment", PAGES, indirect=True)
def test_rows_are_of_what_is_declared(experiment):
    name, module = experiment
    found = json.loads((FOLDERS / name / "specification.json").read_text(encoding="utf-8"))
    table = module.TABLE
    assert found["declared"] == table.specification(table.first_seed)["declared"]
    asked = {unit.name for unit in table.units(table.first_seed)}
    assert set(pq.read_table(FOLDERS / name / "rows.parquet")["unit"].to_pylist()) <= asked


@pytest.mark.parametrize("name", PAGES)
def test_who_reads_the_rows_alone_finds_the_page_s_numbers(name):
    script = ROOT / "benchmarks" / "tables" / f"read_{name}.py"
    assert "integ_gym" not in script.read_text(encoding="utf-8").split('"""')[2]
    done = subprocess.run(
        [sys.executable, str(script), str(FOLDERS / name)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    page = PAGES[name].read_text(encoding="utf-8")
    assert done.stdout.strip() in page


@pytest.mark.parametrize("experiment", ["learned_engines"], indirect=True)
def test_a_step_of_an_engine_is_of_the_map_that_it_is_trained_by(experiment):
    _, module = experiment
    asked = module.units(module.TABLE.first_seed)
    assert len({unit.name for unit in asked}) == len(asked)
    for unit in {(unit.task, unit.arm, unit.trained_on): unit for unit in asked}.values():
        if unit.map is not None:
            given = module.arguments(unit.task, unit.arm, unit.trained_on)
            assert module.defect(given, unit.map) < 2e-6
    for name in ("pybullet", "sapien"):
        with pytest.raises(RuntimeError, match="is not one of symplectic_euler"):
            module.defect(module.arguments("swing-up", "as got", name), "symplectic_euler")
    differs = module.contract("short track", "matched", "native", "mujoco")["differs"]
    assert not differs


@pytest.mark.slow
def test_a_block_is_run_and_one_that_is_there_is_not_run_again(tmp_path):
    script = ROOT / "benchmarks" / "tables" / "learned_periods.py"
    command = [sys.executable, str(script), "--out", str(tmp_path), "--workers", "1"]
    command += ["--only", "cart-pole-hand-made"]
    first, again = (
        subprocess.run(command, capture_output=True, text=True, check=True) for _ in range(2)
    )
    assert "| cart-pole |" in first.stdout
    assert again.stdout == first.stdout
    refused = subprocess.run(
        [*command, "--first-seed", "1"], capture_output=True, text=True, check=False
    )
    assert refused.returncode
    assert "was made with other declared; give another folder" in refused.stderr
