"""Every benchmark runs: short turns of what it measures, a table, and JSON with the machine."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"
SHORT = {
    "attacks": ["--tries", "1", "--only", "hostile"],
    "claims": ["--units", "500", "--workers", "20", "--failures", "200"],
    "engines": ["--only", "mujoco", "--seconds", "0.01"],
    "env_throughput": ["--only", "single", "vector", "--seconds", "0.01"],
    "error_rates": ["--seeds", "8", "--repeats", "2"],
    "executor_overhead": ["--only", "local", "dask", "--seconds", "0.2", "--units", "2"],
    "evidence_cost": ["--seconds", "0.05", "--episodes", "2000"],
    "multibody_a01": ["--only", "rk4", "--seconds", "2"],
    "panel_cost": ["--only", "single", "--steps", "4096", "--runs", "1"],
    "reference_cost": [],
    "trainer_equivalence": ["--only", "cart-pole", "--seeds", "2", "--steps", "4096"],
    "verification_cost": ["--records", "40"],
}
OF_A_RUN = {"closed_loops", "panel_tables"}
"""Tested beside what they read."""


def test_every_benchmark_is_run():
    assert {file.stem for file in FOLDER.glob("*.py")} == set(SHORT) | OF_A_RUN


@pytest.mark.slow
@pytest.mark.parametrize("name", SHORT)
def test_a_benchmark_runs(name, tmp_path):
    output = tmp_path / "found.json"
    command = [sys.executable, str(FOLDER / f"{name}.py"), *SHORT[name], "--json", str(output)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) > 2
    found = json.loads(output.read_text(encoding="utf-8"))
    assert found["machine"]["cores"] >= 1
    assert found["versions"]["integ-gym"]


def test_help_says_what_is_measured():
    for name in SHORT:
        command = [sys.executable, str(FOLDER / f"{name}.py"), "--help"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, ""), name
        assert "--json" in done.stdout
