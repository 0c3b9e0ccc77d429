"""Commands whose standard streams are closed, as some schedulers start them."""

from __future__ import annotations

import subprocess
import sys

import pytest

COMMAND = [sys.executable, "-m", "integ_gym.cli"]


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["--help"], 0),
        (["engines", "--engine", "native"], 0),
        (["evidence", "query", "no-such-run", "SELECT 1"], 2),
        (["evalute"], 2),
    ],
    ids=lambda value: "-".join(value) if isinstance(value, list) else "",
)
@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-", "<&-"])
def test_a_command_needs_no_standard_streams(words, code, closed, tmp_path):
    line = ["sh", "-c", f'"$@" {closed}', "sh", *COMMAND, *words]
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
