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
@pytest.mark.parametrize("name", SHORT)
def test_a_benchmark_runs(name, tmp_path):
    output = tmp_path / "found.json"
    done = _run(name, *SHORT[name], "--json", str(output), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) > 2
    found = json.loads(output.read_text(encoding="utf-8"))
    assert found["machine"]["cores"] >= 1
    assert found["versions"]["integ-gym"]


HELP = """
import contextlib, io, runpy, sys
folder, *names = sys.argv[1:]
sys.path.insert(0, folder)
for name in names:
    sys.argv[1:] = ["--help"]
    with contextlib.redirect_stdout(io.StringIO()) as told, contextlib.suppress(SystemExit):
        runpy.run_path(f"{folder}/{name}.py", run_name="__main__")
    print(name, "--json" in told.getvalue())
"""


def test_help_says_what_is_measured():
    command = [sys.executable, "-c", HELP, str(FOLDER), *SHORT]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines() == [f"{name} True" for name in SHORT]


def test_what_falls_below_its_bound_is_said_and_fails(tmp_path):
    """A file of every benchmark, as `make bench` leaves them, with what each bound is about."""
    rows = [
        {"kind": kind, "environment": f"Integ{name}-v0", "detail": detail, "lanes": lanes,
         "ratios": {"gymnasium": 2.0, "envpool": 100.0, "fastest envpool": 100.0}}
        for name in ("Pendulum", "CartPole")
        for kind, detail, lanes in (
            ("single", "", 1), ("single", "with evidence", 1), ("vector", "explicit_euler", 1024),
            ("vector", "symplectic_euler", 16), ("vector", "symplectic_euler", 1024),
            ("vector", "rk4", 1024), ("vector", "explicit_euler, compiled", 1024),
            ("vector", "symplectic_euler, compiled", 1024),
            ("scan", "symplectic_euler", 4096),
        )
    ]  # fmt: skip
    engines = [
        {"engine": engine, "count": count, "variant": "", "ratios": {"bare": [1.0, 1.1, 1.2]}}
        for engine in ("mujoco", "drake")
        for count in (1, 20)
    ]
    recorded = {"environment": "IntegPendulum-v0", "lanes": 1024, "trace": True, "in_all": 0.5}
    figures = {"help": 1.0, "import": 1.0, "policy": 5.0, "policy over training": 1.5}
    seconds = {"fleet": 1.0, "fleet, compiled before": 1.0, "sb3": 90.0, "sb3 per core": 50.0}
    contents = {
        "env_throughput": {"rows": rows},
        "evidence_cost": {"recording": [recorded]},
        "panel_cost": {
            "parts": {"panel": {"seconds_per_policy": seconds}, "single": {"seconds": seconds}}
        },
        "engines": {"rows": engines},
        "reference_cost": {"rows": [{"inner_steps": 1, "rk4_steps": 15.0}]},
        "startup": {"figures": figures},
    }
    for name, content in contents.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    done = _run("bounds", str(tmp_path), folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert all(line.endswith("met") for line in done.stdout.splitlines()[2:])
    recorded["in_all"], engines[1]["ratios"]["bare"][1] = 0.2, 9.0
    del figures["help"]
    for name in ("evidence_cost", "engines", "startup"):
        (tmp_path / f"{name}.json").write_text(json.dumps(contents[name]))
    done = _run("bounds", str(tmp_path), folder=tmp_path)
    assert done.returncode == 1
    assert "within the bound" in done.stdout
    assert done.stderr == (
        "\nMISSED: mujoco, 20 steps / bare loop (MISSED); "
        "integ-gym --help / import gymnasium (not measured)\n"
    )
