"""Files that one process holds at a time."""

from __future__ import annotations

import subprocess
import sys

from integ_gym.support.storage import FileLock

HOLDER = """
import sys, time
from pathlib import Path
from integ_gym.support.storage import FileLock
assert FileLock(Path(sys.argv[1])).acquire()
print("held", flush=True)
time.sleep(600.0)
"""


def test_one_holder_at_a_time(tmp_path):
    one, other = FileLock(tmp_path / "lock"), FileLock(tmp_path / "lock")
    assert one.acquire()
    assert not other.acquire()
    other.release()
    assert not other.acquire()
    one.release()
    assert list(tmp_path.iterdir()) == []
    assert other.acquire()
    other.release()


def test_a_killed_holder_holds_nothing(tmp_path):
    command = [sys.executable, "-c", HOLDER, str(tmp_path / "lock")]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"held\n"
        lock = FileLock(tmp_path / "lock")
        assert not lock.acquire()
        holder.kill()
    assert lock.acquire()
    lock.release()
