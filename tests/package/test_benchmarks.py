"""Every benchmark runs: short turns of what it measures, a table, and JSON with the machine."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"
SHORT = {
    "attacks": ["--tries", "1", "--only", "hostile"],
    "contact": ["--only", "rk4"],
    "engine_contact": ["--only", "native", "mujoco"],
    "engines": ["--only", "mujoco", "--seconds", "0.01"],
    "env_throughput": ["--only", "single", "vector", "--seconds", "0.01"],
    "error_rates": ["--seeds", "8", "--repeats", "2"],
    "executor_overhead": ["--only", "local", "dask", "--seconds", "0.2", "--units", "2"],
    "evidence_cost": ["--seconds", "0.05", "--episodes", "2000"],
    "limit_coverage": ["--seeds", "0", "--repeats", "1", "--steps", "4096"],
    "multibody_a01": ["--only", "rk4", "stormer_verlet", "--seconds", "1"],
    "panel_cost": ["--only", "single", "share", "--steps", "4096", "--runs", "1"],
    "reference_cost": [],
    "startup": ["--turns", "1", "--steps", "4096"],
    "trainer_equivalence": ["--only", "cart-pole", "--seeds", "2", "--steps", "4096"],
    "verification_cost": ["--records", "40"],
}


def _run(name: str, *words: str, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(FOLDER / f"{name}.py"), *words]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)


@pytest.mark.slow
def test_other_libraries_are_run_where_they_are_installed(tmp_path):
    done = _run("other_libraries", "--only", "sb3-contrib", "sbx", folder=tmp_path)
    assert done.returncode == 0, done.stdout
    assert "PASS  sb3-contrib" in done.stdout
    assert "sbx is left out" in done.stdout


@pytest.mark.slow
def test_five_journeys_are_walked(tmp_path):
    done = _run("house", "--journeys", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    counts = [int(n) for n in re.findall(r": (\d+) files$", done.stdout, re.MULTILINE)]
    assert len(counts) == 5
    assert min(counts) > 5


@pytest.mark.slow
@pytest.mark.parametrize("name", SHORT)
def test_a_benchmark_runs(name, tmp_path):
    output = tmp_path / "found.json"
    done = _run(name, *SHORT[name], "--json", str(output), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) > 2
    found = json.loads(output.read_text(encoding="utf-8"))
    assert found["machine"]["cores"] >= 1
    assert found["versions"]["integ-gym"]
