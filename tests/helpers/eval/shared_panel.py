"""A panel that is trained by the fleet in a moment, and what makes two runs of it equal."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import psutil
from victim import records_of

from integ_gym.cli import main
from integ_gym.support import figures as style

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
total_steps = 163840
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

PATIENCE = 500.0
"""Time after which a run is taken for stuck, s."""

PRELOADED = (
    "duckdb", "matplotlib.figure", "pyarrow.parquet", "integ_gym.cli",
    "integ_gym.commands.panel", "integ_gym.eval.panel.run",
    "integ_gym.eval.panel.outputs", "shared_panel",
)  # fmt: skip


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
    assert [file.name for file in run.rglob(".*") if file.name != ".lock"] == []


def two_processes() -> ProcessPoolExecutor:
    """An executor as one's own module may give it."""
    return ProcessPoolExecutor(WORKERS, mp_context=multiprocessing.get_context("spawn"))


def started(command: Sequence[str], **told: str) -> Any:
    """A process, head of its group, that runs a command; what else its environment tells.

    It is forked from one that has imported what the command needs and run nothing.
    """
    context: Any = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(PRELOADED))
    process = context.Process(target=_run, args=(list(command), told))
    process.start()
    return process


def _run(command: list[str], told: dict[str, str]) -> None:
    os.setpgid(0, 0)
    os.environ.update(told)
    style.FORMATS = {".png": style.FORMATS[".png"]}
    sys.exit(main(command))


def ended(process: Any) -> int:
    """Exit code of a process that ends by itself."""
    process.join(PATIENCE)
    if process.is_alive():
        kill_group(process)
        raise AssertionError(f"still running after {PATIENCE:g} s")
    return int(process.exitcode)


def kill_group(process: Any) -> None:
    """Kill a process with all that it started in its group."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.join()


def until(holds: Callable[[], Any], process: Any) -> Any:
    """Wait until something holds while a process runs; what it gives."""
    deadline = time.monotonic() + PATIENCE
    while not (found := holds()):
        assert process.is_alive(), "it ended before it could be disturbed"
        assert time.monotonic() < deadline, "it does not come so far"
        time.sleep(0.01)
    return found


BUSY_SECONDS = 1.5
"""Processor time after which a worker trains: half of what its first units take in all, s."""


def kill_a_worker(parent: int, named: str, driver: Any) -> None:
    """Kill a process below another, in the middle of its work.

    Args:
        parent: process whose descendants are looked through.
        named: part of the command line.
        driver: what is running meanwhile.
    """

    def killed() -> bool:
        for process in psutil.Process(parent).children(recursive=True):
            with contextlib.suppress(psutil.NoSuchProcess, psutil.AccessDenied):
                times = process.cpu_times()
                is_named = named in " ".join(process.cmdline())
                if is_named and times.user + times.system > BUSY_SECONDS:
                    process.kill()
                    return True
        return False

    until(killed, driver)
