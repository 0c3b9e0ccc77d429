"""Programs that cannot start worker processes are told so before anything is created."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from integ_gym.support.processes import SpawnError, check_spawning

CALL = (
    "from integ_gym.support.processes import check_spawning\n{}check_spawning({})\nprint('fine')\n"
)
GUARD = 'if __name__ == "__main__":\n    '


def _run(program: str, folder: Path, how: str) -> subprocess.CompletedProcess[str]:
    script = folder / "script.py"
    script.write_text(program)
    command = {"file": [str(script)], "stdin": ["-"], "text": ["-c", program]}[how]
    given = program if how == "stdin" else None
    return subprocess.run(
        [sys.executable, *command], input=given, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize(
    ("program", "how", "said"),
    [
        (CALL.format("", ""), "file", 'without `if __name__ == "__main__":`'),
        (CALL.format("", "") + GUARD + "pass", "file", 'without `if __name__ == "__main__":`'),
        (CALL.format("", ""), "stdin", "read from standard input"),
        ("def mine(): pass\n" + CALL.format("", "mine"), "text", "defined in a notebook"),
        (CALL.format(GUARD, "lambda: 0"), "file", "define it at the top of a module"),
    ],
)
def test_what_cannot_be_started_is_refused_in_a_sentence(program, how, said, tmp_path):
    done = _run(program, tmp_path, how)
    assert done.returncode == 1
    assert said in done.stderr
    assert "workers=1" not in done.stderr


@pytest.mark.parametrize(
    ("program", "how"), [(CALL.format(GUARD, ""), "file"), (CALL.format("", "print"), "text")]
)
def test_what_can_be_started_is_not(program, how, tmp_path):
    done = _run(program, tmp_path, how)
    assert done.returncode == 0, done.stderr
    assert "fine" in done.stdout


def test_one_worker_is_a_remedy_where_it_works_in_this_process(tmp_path):
    done = _run(CALL.format("", "alone=True"), tmp_path, "file")
    assert done.returncode == 1
    assert "or ask for one worker (workers=1), which works in this process" in done.stderr


def test_here_processes_can_be_started():
    check_spawning(print)
    with pytest.raises(SpawnError, match="worker processes cannot be given"):
        check_spawning(lambda: 0)
