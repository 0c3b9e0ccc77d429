"""A panel that is trained by the fleet in a moment, and what makes two runs of it equal."""

from __future__ import annotations

from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from victim import records_of

TOML = """
name = "shared"
env_id = "IntegPendulum-v0"
control_period = 0.05
seeds = [0, 1]
episodes = 3
trace_every = 3
baselines = ["zero"]
perturbations = []
ladder = false

[environment]
start = "hanging"
max_torque = 1.0
duration = 1.0

[training]
total_steps = 2048
n_envs = 4
n_steps = 128
batch_size = 128
n_epochs = 2
net_arch = [8]

[[train]]
integrator = ["rk4", "explicit_euler"]
dt = 0.05

[[evaluate]]
integrator = ["rk4", "explicit_euler"]
dt = [0.05, 0.025]
"""

WORKERS = 2
"""Processes that every run of it is divided for."""


def specification(folder: Path) -> Path:
    """Its specification, in a file."""
    path = folder / "shared.toml"
    path.write_text(TOML, encoding="utf-8")
    return path


def words(folder: Path, out: Path, *more: str) -> list[str]:
    """The words of the command that runs it."""
    spec = str(specification(folder))
    given = ["panel", spec, "--out", str(out), "--workers", str(WORKERS), "--no-progress"]
    return [*given, *more]


def assert_equal_records(run: Path, other: Path) -> None:
    """Both hold the same records, each once, and nothing is left of the work."""
    found, expected = records_of(run), records_of(other)
    assert set(Counter(found.values())) == {1}
    assert found == expected
    assert not [file for file in run.rglob(".*") if file.name != ".lock"]


def two_processes() -> ProcessPoolExecutor:
    """An executor as one's own module may give it."""
    return ProcessPoolExecutor(WORKERS, mp_context=get_context("spawn"))
