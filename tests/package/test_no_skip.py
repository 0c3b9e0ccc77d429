"""``pytest --no-skip``: what continuous integration relies on."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

TESTS = """
import pytest

def test_skipped():
    pytest.skip("for lack of something")

@pytest.mark.skipif(True, reason="never")
def test_marked():
    pass

def test_passes():
    pass
"""


def test_a_skipped_test_fails(tmp_path):
    (tmp_path / "test_some.py").write_text(TESTS, encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-p", "conftest", "--no-skip", str(tmp_path)]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1, done.stdout
    assert "for lack of something" in done.stdout
    assert "1 passed" in done.stdout
