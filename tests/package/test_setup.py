"""What each target of the Makefile sets up, and that one adds to another."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent.parent
PANEL, TRAIN, REST = '".[panel]"', '".[panel,train]"', '".[all]" --group dev'


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, tmp_path)
    (tmp_path / ".venv").mkdir()
    return tmp_path


def _installed(clone: Path, target: str) -> list[str]:
    """What a target would install."""
    done = subprocess.run(
        ["make", "--dry-run", target], cwd=clone, check=True, capture_output=True, text=True
    )
    return re.findall(r"--editable (.*)", done.stdout)


def test_each_target_installs_what_it_needs(clone):
    assert _installed(clone, "panel") == [PANEL]
    assert _installed(clone, "train") == [PANEL, TRAIN]
    assert _installed(clone, "test") == [PANEL, TRAIN, REST]


def test_what_is_there_is_not_installed_again(clone):
    for name in (".panel", ".train", ".ready"):
        (clone / ".venv" / name).touch()
        os.utime(clone / ".venv" / name)
        assert _installed(clone, "panel") == []
    assert _installed(clone, "test") == []
    (clone / ".venv" / ".ready").unlink()
    assert _installed(clone, "test") == [REST]
    os.utime(clone / "constraints.txt", (4e9, 4e9))
    assert _installed(clone, "panel") == [PANEL]
