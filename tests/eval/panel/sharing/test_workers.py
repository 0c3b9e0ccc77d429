"""Processes that share nothing but a directory finish a panel, whatever becomes of some of them."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess

import pytest
from shared_panel import (
    TOML,
    assert_equal_records,
    ended,
    holders,
    kill_group,
    started,
    until,
    words,
)

from integ_gym.cli import main

LEASE = 6.0


def _workers(folder, run, count):
    given = words(folder, run, "--worker", "--lease", f"{LEASE:g}")
    return [started(given) for _ in range(count)]


@pytest.mark.slow
def test_eight_of_which_three_are_killed_and_one_sleeps_beyond_its_lease(tmp_path, undisturbed):
    run = tmp_path / "run"
    workers = {process.pid: process for process in _workers(tmp_path, run, 8)}
    some = next(iter(workers.values()))
    held = until(lambda: holders(run, "shared"), some)
    unit, sleeper = next((u, pid) for u, pid in held.items())
    os.kill(sleeper, signal.SIGSTOP)
    others = [pid for pid in workers if pid != sleeper]
    for pid in others[:3]:
        os.kill(pid, signal.SIGKILL)
    claims, alive = run / ".work" / "shared" / "claims", workers[others[3]]
    until(lambda: list(claims.rglob(f"{unit}.2")), alive)
    os.kill(sleeper, signal.SIGCONT)
    codes = {pid: ended(process) for pid, process in workers.items()}
    for process in workers.values():
        kill_group(process)
    assert {codes[pid] for pid in others[:3]} == {-signal.SIGKILL}
    assert {codes[pid] for pid in (*others[3:], sleeper)} == {0}
    assert_equal_records(run, undisturbed)


@pytest.mark.slow
def test_a_driver_finishes_what_workers_began(tmp_path, undisturbed):
    run = tmp_path / "run"
    (worker,) = _workers(tmp_path, run, 1)
    until(lambda: list(run.glob("units/train-*.json")), worker)
    refused = started(words(tmp_path, run))
    assert ended(refused) == 2, "a worker is there"
    kill_group(worker)
    kept = {file: file.stat().st_mtime_ns for file in run.glob("units/*.json")}
    assert ended(started(words(tmp_path, run))) == 0
    assert kept == {file: file.stat().st_mtime_ns for file in kept}
    assert_equal_records(run, undisturbed)


@pytest.mark.slow
def test_a_worker_that_comes_late_finds_nothing_to_do(tmp_path, undisturbed, capsys):
    seal = (undisturbed / "seal.json").read_bytes()
    assert main(words(tmp_path, undisturbed, "--worker")) == 0
    assert "0 units done here" in capsys.readouterr().out
    assert (undisturbed / "seal.json").read_bytes() == seal


@pytest.mark.slow
def test_workers_let_a_finished_panel_grow_take_its_policies_and_sign_what_they_made(
    tmp_path, undisturbed, capsys
):
    """Two that find a sealed panel let it grow; two make the same of its policies elsewhere."""
    run, once, key = tmp_path / "run", tmp_path / "once", tmp_path / "key"
    public = tmp_path / "key.pub"
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(key)], check=True)
    shutil.copytree(undisturbed, run)
    files = {p: p.stat().st_mtime_ns for p in run.glob("[uep]*/**/*") if p.is_file()}

    def work(out, episodes, *more):
        command = words(tmp_path, out, "--worker", *more)
        larger = TOML.replace("episodes = 3", f"episodes = {episodes}")
        (tmp_path / "shared.toml").write_text(larger, encoding="utf-8")
        assert [ended(one) for one in [started(command), started(command)]] == [0, 0]

    work(run, 5)
    assert files == {path: path.stat().st_mtime_ns for path in files}
    assert main(["evidence", "verify", str(run)]) == 0
    work(once, [3, 2], "--policies", str(run), "--sign", str(key))
    assert_equal_records(once, run)
    capsys.readouterr()
    assert main(["evidence", "verify", str(once), "--public-key", str(public)]) == 0
    assert "signed: by SHA256:" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (("--executor", "ray"), "--executor is not for --worker"),
        (("--policies", "runs/none"), "runs/none holds no panel; give --policies"),
        (("--lease", "0"), "a lease takes 1 s or more"),
    ],
)
def test_what_is_not_for_workers_is_refused(tmp_path, more, told, capsys):
    assert main(words(tmp_path, tmp_path / "run", "--worker", *more)) == 2
    assert told in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
