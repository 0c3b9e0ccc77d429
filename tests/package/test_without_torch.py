"""A panel, its page and its verification in processes that can import no torch."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from small_panel import TOML

BLOCKED = """
import sys
from importlib.machinery import PathFinder

HIDDEN = ("torch", "stable_baselines3", "tensorboard", "mujoco")


class Finder(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        if name.partition(".")[0] in HIDDEN:
            return None
        return super().find_spec(name, path, target)


sys.meta_path[sys.meta_path.index(PathFinder)] = Finder
"""
SPEC = TOML.replace('trainer = "sb3"', "")


@pytest.mark.slow
def test_a_panel_and_all_that_is_done_with_it_needs_no_torch(tmp_path: Path):
    (tmp_path / "blocked").mkdir()
    (tmp_path / "blocked" / "sitecustomize.py").write_text(BLOCKED)
    (tmp_path / "light.toml").write_text(SPEC)
    own = {**os.environ, "PYTHONPATH": str(tmp_path / "blocked")}

    def command(*words: str) -> str:
        line = [sys.executable, "-m", "integ_gym.cli", *words]
        done = subprocess.run(line, cwd=tmp_path, env=own, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    command("panel", "light.toml", "--out", "run", "--no-progress")
    assert "</html>" in (tmp_path / "run" / "report.html").read_text("utf-8")
    policies = tmp_path / "run" / "policies"
    for folder in policies.iterdir():
        assert {file.name for file in folder.iterdir()} == {"policy.json", "policy.safetensors"}
    panel = json.loads((tmp_path / "run" / "panel.json").read_text("utf-8"))
    file = panel["rows"][0]["policies"][0]["file"]
    assert file == "policies/explicit_euler-dt-0.05-seed0/policy.safetensors"
    assert "whole: every content hash matches" in command("evidence", "verify", "run")
    before = (tmp_path / "run" / "panel.json").read_bytes()
    command("panel", "light.toml", "--out", "run", "--no-progress")
    assert (tmp_path / "run" / "panel.json").read_bytes() == before
    command("report", "run")
    kept = str(policies / "rk4-dt-0.05-seed0" / "policy.safetensors")
    cell = ("--integrator", "rk4", "--dt", "0.05", "--episodes", "2", "--no-progress")
    command("evaluate", kept, "--env", "IntegPendulum-v0", "--out", "mine", *cell)
    refused = [sys.executable, "-m", "integ_gym.cli", "panel", "light.toml"]
    refused += ["--trainer", "sb3", "--out", "other"]
    done = subprocess.run(refused, cwd=tmp_path, env=own, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.endswith('is not installed; run: pip install -e ".[train]"\n')
