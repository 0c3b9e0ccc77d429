"""Worker processes end with what started them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from integ_gym.support.processes import Progress, limit_threads, report_work
from integ_gym.support.terminal import WorkBar

SCRIPT = """
import signal
import time
from multiprocessing import active_children
from integ_gym.support.processes import Progress

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with Progress().pool(2) as pool:
        tasks = [pool.submit(time.sleep, 600.0) for _ in range(6)]
        while not tasks[1].running():
            time.sleep(0.01)
        print(*[process.pid for process in active_children()], flush=True)
        tasks[0].result()
"""


def test_what_is_done_at_once_moves_the_bar_and_can_be_interrupted():
    bar = WorkBar("work", 10.0, shown=True)
    progress = Progress(bar, "starting")

    def work(amount, error=None):
        report_work(amount)
        if error is not None:
            raise error
        return amount

    with progress.at_once() as executor:
        assert executor.submit(work, 4.0).result() == bar.n == 4.0
        failed = executor.submit(work, 1.0, ValueError("no"))
        with pytest.raises(ValueError, match="no"):
            failed.result()
        assert bar.n == 5.0
        with pytest.raises(KeyboardInterrupt):
            executor.submit(work, 1.0, KeyboardInterrupt())
    report_work(1.0)
    assert bar.n == 6.0


def test_work_that_was_done_before_says_nothing_of_how_long_the_rest_takes(capsys):
    with suppress(ValueError), WorkBar("work", 10.0, shown=True) as bar:
        progress = Progress(bar)
        progress.begin_at(4.0)
        assert bar.n == 4.0
        bar.describe("begins")
        progress.add(2.0)
        assert bar.n == 6.0
        raise ValueError
    first, *_ = capsys.readouterr().err.splitlines()
    assert "40%" in first
    assert "left" not in first


def test_a_bar_is_full_only_when_its_work_is_done(capsys):
    """An estimate that was too low, or counted work before its files are written."""
    with WorkBar("work", 10.0, shown=True) as bar:
        bar.update(10.0)
        bar.describe("writing")
        early = capsys.readouterr().err
        assert " 99%" in early
        assert "nearly done, writing" in early.splitlines()[-1]
    assert "100%" not in early
    last = capsys.readouterr().err.splitlines()[-1]
    assert "100%" in last
    assert "left" not in last


def test_a_bar_of_failed_work_is_not_full(capsys):
    with suppress(ValueError), WorkBar("work", 10.0, shown=True) as bar:
        bar.update(20.0)
        raise ValueError
    assert "100%" not in capsys.readouterr().err


def test_a_bar_starts_no_thread(capsys, monkeypatch):
    before = threading.active_count()
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    with WorkBar("work", 10.0, shown=True) as bar:
        bar.update(5.0)
        assert threading.active_count() == before
    assert "100%" in capsys.readouterr().err


def test_an_interruption_of_the_main_process_alone_ends_its_workers(tmp_path):
    """As a supervisor interrupts, which unlike a terminal does not interrupt the workers.

    A process that is started in the background may have been told to ignore interruptions.
    """
    script = tmp_path / "waits.py"
    script.write_text(SCRIPT, encoding="utf-8")
    process = subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    workers = [int(word) for word in process.stdout.readline().split()]
    assert len(workers) == 2
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=60.0)
    assert "KeyboardInterrupt" in error
    deadline = time.monotonic() + 30.0
    while any(map(_alive, workers)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(map(_alive, workers))


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_numerical_libraries_have_one_thread_for_a_while():
    with threadpool_limits(limits=2):
        before = _threads()
        assert set(before) == {2}
        with limit_threads():
            assert set(_threads()) == {1}
        assert _threads() == before


def _threads():
    return [library["num_threads"] for library in threadpool_info()]
