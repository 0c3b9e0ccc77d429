"""docs/how-to/adding.md: its files work together as they stand on the page."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from importlib import import_module

import pytest
from house import page_blocks

from integ_gym.cli import main
from integ_gym.envs.numerics.stepping import advance
from integ_gym.eval.diagnosis import run

PAGE = "docs/how-to/adding.md"


def test_task_plant_and_integrator_of_the_page_run(tmp_path, monkeypatch, capsys):
    """A task in a process of its own; what the integrator is, by three sections."""
    for block in page_blocks(PAGE, "python"):
        (name,) = re.findall(r"\A# (\w+\.py)$", block, re.MULTILINE)
        (tmp_path / name).write_text(block, encoding="utf-8")
    command = [sys.executable, "-W", "error", "use_task.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert re.search(r"x = -?\d\.\d{3} m", done.stdout)
    assert "(8, 2)" in done.stdout
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    bouncer = import_module("my_bouncer").Bouncer()
    _, speed = advance("rk4", bouncer, (0.001, -1.0), 1e-4, 400)
    assert speed == pytest.approx(0.75, abs=0.01)
    sections = ("plant", "integrator", "stiffness")
    monkeypatch.setattr(run, "SECTIONS", {name: run.SECTIONS[name] for name in sections})
    words = shlex.split(page_blocks(PAGE, "sh")[0])[1:]
    assert main([*words, "--all", "--no-progress", "--workers", "1"]) == 0
    printed = capsys.readouterr().out
    rows = {" ".join(row.split()) for row in printed.splitlines()}
    told = next(block for block in page_blocks(PAGE, "text") if not block.startswith("integ-gym"))
    assert {" ".join(row.split()) for row in told.splitlines()} <= rows
    assert "my_plant:Slider, plant: rate of energy" in printed


def test_parts_of_ones_own_need_the_users_door_alone():
    code = "\n".join(page_blocks(PAGE, "python"))
    imported = re.findall(r"^(?:from|import) (integ_gym\S*)", code, re.MULTILINE)
    assert set(imported) == {"integ_gym"}
