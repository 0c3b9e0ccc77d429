"""Threads and worker processes: items made ahead, what can be started, and how it ends."""

import os
import platform
import signal
import subprocess
import sys
import threading
import time
import warnings

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from integ_gym.support.errors import FileWarning
from integ_gym.support.processes import (
    Progress,
    SpawnError,
    check_spawning,
    limit_threads,
    prefetch,
    report_work,
)
from integ_gym.support.terminal import WorkBar

PATIENCE = 60.0
"""Until a thread or process that should have come is given up, s."""


def _python(program, how="-c", given=None, folder=None):
    words = {"file": ["script.py"], "stdin": ["-"], "text": ["-c", program]}.get(
        how, [how, program]
    )
    if how == "file":
        (folder / "script.py").write_text(program)
    given = program if how == "stdin" else None
    return subprocess.run(
        [sys.executable, *words], input=given, capture_output=True, text=True, check=False,
        cwd=folder,
    )  # fmt: skip


def test_items_come_in_their_order_and_the_next_is_made_while_one_is_used():
    assert list(prefetch(iter(range(5)))) == [0, 1, 2, 3, 4]
    assert list(prefetch(iter([]))) == []
    assert list(prefetch(iter([None, None]))) == [None, None]
    made = [threading.Event() for _ in range(3)]

    def items():
        for number, event in enumerate(made):
            event.set()
            yield number
        raise ValueError("no fourth")

    following = prefetch(items())
    for expected in range(3):
        assert next(following) == expected
        assert made[min(expected + 1, 2)].wait(PATIENCE)
    with pytest.raises(ValueError, match="no fourth"):
        next(following)


def test_no_item_is_lost_where_threads_end_in_between():
    """The main thread ends while another goes on: the second item can be given to no thread."""
    program = """
import threading
from integ_gym.support.processes import prefetch

def use():
    following = prefetch(iter(range(4)))
    found = [next(following)]
    ended.wait()
    print(found + list(following))

ended = threading.Event()
threading.Thread(target=use).start()
threading._register_atexit(ended.set)
"""
    done = _python(program)
    assert (done.stdout, done.stderr) == ("[0, 1, 2, 3]\n", "")


CALL = (
    "from integ_gym.support.processes import check_spawning\n{}check_spawning({})\nprint('fine')\n"
)
GUARD = 'if __name__ == "__main__":\n    '


@pytest.mark.parametrize(
    ("program", "how", "said"),
    [
        (CALL.format("", "") + GUARD + "pass", "file", 'without `if __name__ == "__main__":`'),
        (CALL.format("", "alone=True"), "file", "(workers=1), which works in this process"),
        (CALL.format("", ""), "stdin", "read from standard input"),
        ("def mine(): pass\n" + CALL.format("", "mine"), "text", "defined in a notebook"),
        (CALL.format(GUARD, ""), "file", None),
        (CALL.format("", "print"), "text", None),
    ],
)
def test_a_program_that_cannot_start_workers_is_told_so(program, how, said, tmp_path):
    done = _python(program, how, folder=tmp_path)
    assert done.returncode == (said is not None), done.stderr
    assert said in done.stderr if said else "fine" in done.stdout


def test_here_processes_can_be_started():
    check_spawning(print)
    with pytest.raises(SpawnError, match="worker processes cannot be given"):
        check_spawning(lambda: 0)


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


WAITS = """
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


def test_an_interruption_of_the_main_process_alone_ends_its_workers(tmp_path):
    """As a supervisor interrupts, which unlike a terminal does not interrupt the workers.

    A process that is started in the background may have been told to ignore interruptions.
    """
    script = tmp_path / "waits.py"
    script.write_text(WAITS, encoding="utf-8")
    process = subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    workers = [int(word) for word in process.stdout.readline().split()]
    assert len(workers) == 2
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=PATIENCE)
    assert "KeyboardInterrupt" in error
    deadline = time.monotonic() + PATIENCE
    while any(map(_alive, workers)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(map(_alive, workers))


def _alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_workers_do_not_repeat_what_is_said_of_a_file(capfd):
    with Progress(WorkBar("", 1.0, False)).pool(1) as pool:
        pool.submit(warnings.warn, "said by who starts workers", FileWarning).result(PATIENCE)
        pool.submit(warnings.warn, "said by any").result(PATIENCE)
    said = capfd.readouterr().err
    assert "said by any" in said
    assert "starts workers" not in said


FREED = """
import sys

from integ_gym.support.processes import release_memory

def resident():
    return int(open("/proc/self/statm").read().split()[1]) * 4096 / 1e6

blocks = [bytes(1000) for _ in range(100_000)]
last = bytes(1000)  # above the others, so that they are kept when they are freed
before = resident()
del blocks
kept = resident()
release_memory()
print(before - kept, kept - resident())
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="of glibc alone")
def test_what_was_freed_goes_back_to_the_system():
    at_once, released = map(float, _python(FREED).stdout.split())
    assert at_once < 20.0
    assert released > 60.0


def test_numerical_libraries_have_one_thread_for_a_while():
    def threads():
        return {library["num_threads"] for library in threadpool_info()}

    with threadpool_limits(limits=2):
        assert threads() == {2}
        with limit_threads():
            assert threads() == {1}
        assert threads() == {2}
