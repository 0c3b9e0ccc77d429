"""docs/how-to/adding.md: its files work together as they stand on the page."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from house import page_blocks

PAGE = "docs/how-to/adding.md"


@pytest.fixture(scope="module")
def directory(tmp_path_factory) -> Path:
    """A directory with the page's files."""
    folder = tmp_path_factory.mktemp("adding")
    for block in page_blocks(PAGE, "python"):
        (name,) = re.findall(r"\A# (\w+\.py)$", block, re.MULTILINE)
        (folder / name).write_text(block, encoding="utf-8")
    return folder


def _run(directory: Path, *words: str) -> str:
    command = [sys.executable, "-W", "error", *words]
    done = subprocess.run(command, cwd=directory, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_task_runs(directory):
    printed = _run(directory, "use_task.py")
    assert re.search(r"x = -?\d\.\d{3} m", printed)
    assert "(8, 2)" in printed


def test_the_command_tells_the_integrator_what_it_is(directory):
    (command,) = page_blocks(PAGE, "sh")
    words = shlex.split(command)
    assert words[0] == "integ-gym"
    printed = _run(directory, "-m", "integ_gym.cli", *words[1:], "--all", "--no-progress")
    rows = {" ".join(row.split()) for row in printed.splitlines()}
    (told,) = [block for block in page_blocks(PAGE, "text") if not block.startswith("integ-gym")]
    for row in told.splitlines():
        assert " ".join(row.split()) in rows
    assert "my_plant:Slider, plant: rate of energy" in printed
    assert (directory / "runs" / "ralston" / "diagnose.json").exists()


def test_parts_of_ones_own_need_the_users_door_alone():
    code = "\n".join(page_blocks(PAGE, "python"))
    imported = re.findall(r"^(?:from|import) (integ_gym\S*)", code, re.MULTILINE)
    assert imported
    assert set(imported) == {"integ_gym"}
