"""``pytest --no-skip``: what continuous integration relies on."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1]
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


@pytest.mark.parametrize(("options", "outcome"), [(["--no-skip"], 1), ([], 0)])
def test_a_skipped_test_fails(tmp_path, options, outcome):
    (tmp_path / "test_some.py").write_text(TESTS, encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-p", "conftest", *options, str(tmp_path)]
    environment = {**os.environ, "PYTHONPATH": str(FOLDER)}
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == outcome, done.stdout
    assert ("for lack of something" in done.stdout) == bool(options)
    assert "1 passed" in done.stdout
