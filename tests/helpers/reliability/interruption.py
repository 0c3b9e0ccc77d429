"""Runs in processes of their own that are killed, starved of disk, or met by another."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import random
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from victim import Task

from integ_gym.support import figures as style

PRELOADED = (
    "duckdb", "matplotlib.figure", "pyarrow.parquet", "stable_baselines3", "integ_gym.cli",
    "integ_gym.commands.panel", "integ_gym.eval.panel.run",
    "integ_gym.eval.panel.outputs", "integ_gym.train.ppo", "victim",
)  # fmt: skip
PATIENCE, SHORTEST, LONGEST = 240.0, 3.0, 12.0  # s
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL)

_DAC_OVERRIDE = 1 << 1
_VERSION_3 = 0x20080522


def started(task: Task, run: Path, workers: int, before: Callable[[], None] | None = None) -> Any:
    """A process, head of its group, that runs a command in a directory.

    It is forked from one that has imported what the command needs and run nothing.
    """
    context: Any = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(PRELOADED))
    process = context.Process(target=_run, args=(task.given(run, workers), before))
    process.start()
    return process


def ended(process: Any) -> int:
    """Exit code of a process that ends by itself."""
    process.join(PATIENCE)
    if process.is_alive():
        os.killpg(process.pid, signal.SIGKILL)
        raise AssertionError(f"still running after {PATIENCE:g} s")
    return int(process.exitcode)


def killed(task: Task, run: Path, rng: random.Random) -> str:
    """Send a signal to the driver, its group or one worker at a random moment; what was done."""
    workers = rng.choice((1, 1, 1, 2))
    process = started(task, run, workers)
    longest = LONGEST if "panel" in task.words or workers > 1 else SHORTEST
    time.sleep(rng.uniform(0.0, longest))
    number, whom = rng.choice(SIGNALS), rng.choice(("driver", "group", "worker"))
    _send(process, number, whom)
    ended(process)
    _await_workers(process.pid)
    return f"{number.name} to the {whom}, workers: {workers}"


def full_disk(task: Task, run: Path, rng: random.Random) -> str:
    """Leave so many bytes on the disk, or, where none can be mounted, to each file."""
    most = int(10 ** rng.uniform(3.0, 5.7))
    run.mkdir()
    if mounted := _mount(run, f"size={most}"):
        code = ended(started(task, run, 1))
        assert _mount(run, "remount,size=64m")
    else:
        code = ended(started(task, run, 1, _Limited(most)))
    assert code in (0, 2), f"ended with {code}"
    return f"{most} bytes {'on the disk' if mounted else 'a file'}"


def read_only(task: Task, run: Path, rng: random.Random) -> str:
    """Let one of its folders be written to by nobody, root included."""
    folder = run / rng.choice((".", "evidence", "units", "policies"))
    folder.mkdir(parents=True)
    folder.chmod(0o555)
    try:
        code = ended(started(task, run, 1, without_override))
    finally:
        folder.chmod(0o755)
    assert code == 2, f"ended with {code}"
    return str(folder.relative_to(run))


def two_drivers(task: Task, run: Path, rng: random.Random) -> str:
    """Start the command twice in one directory; one of the two is refused, or has nothing to do."""
    first = started(task, run, 1)
    time.sleep(rng.uniform(0.0, SHORTEST))
    second = started(task, run, 1)
    codes = sorted((ended(first), ended(second)))
    assert codes in ([0, 0], [0, 2]), codes
    return f"exit codes {codes}"


def release(run: Path) -> None:
    """Give back a disk that was mounted."""
    if run.is_mount():
        subprocess.run(["umount", str(run)], check=True)


def _mount(run: Path, options: str) -> bool:
    words = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(run)]
    try:
        return subprocess.run(words, capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        return False


def _await_workers(group: int) -> None:
    """Wait until no process of a group is left: workers end with their driver."""
    end = time.monotonic() + PATIENCE
    while _alive(group):
        if time.monotonic() > end:
            raise AssertionError("workers outlive their driver")
        time.sleep(0.05)


def _alive(group: int) -> bool:
    for file in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, own = file.read_text().rpartition(")")[2].split()[:3]
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(own) == group and state != "Z":
            return True
    return False


class _Limited:
    """A limit to the size of files that this process writes."""

    def __init__(self, most: int) -> None:
        self.most = most

    def __call__(self) -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (self.most, resource.RLIM_INFINITY))


def without_override() -> None:
    """Have modes hold for root too: give up the capability to override them, for this process."""
    libc = ctypes.CDLL(None, use_errno=True)
    header = (ctypes.c_uint32 * 2)(_VERSION_3, 0)
    held = (ctypes.c_uint32 * 6)()
    if libc.capget(header, held):
        raise OSError(ctypes.get_errno(), "capget")
    held[0] &= ~_DAC_OVERRIDE
    if libc.capset(header, held):
        raise OSError(ctypes.get_errno(), "capset")


def _run(words: list[str], before: Callable[[], None] | None) -> None:
    from integ_gym.cli import main

    os.setsid()
    style.FORMATS = {".png": style.FORMATS[".png"]}  # pictures are most of the time
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with open(os.devnull, "w") as nowhere:
        for stream in (1, 2):
            os.dup2(nowhere.fileno(), stream)
    if before is not None:
        before()
    sys.exit(main(words))


def _send(process: Any, number: signal.Signals, whom: str) -> None:
    try:
        if whom == "group":
            os.killpg(process.pid, number)
        elif whom == "worker" and (children := _children(process.pid)):
            os.kill(children[-1], number)
        else:
            os.kill(process.pid, number)
    except ProcessLookupError:
        return


def _children(pid: int) -> list[int]:
    tasks = Path(f"/proc/{pid}/task/{pid}/children")
    return [int(child) for child in tasks.read_text().split()] if tasks.exists() else []


INTERRUPTIONS: dict[str, Callable[[Task, Path, random.Random], str]] = {
    "killed": killed,
    "disk full": full_disk,
    "folder read-only": read_only,
    "two drivers": two_drivers,
}
