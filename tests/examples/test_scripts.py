"""The scripts in ``examples`` are short and run as they stand, here for a few steps."""

from __future__ import annotations

import subprocess
import sys

import pytest
from house import ROOT

SCRIPTS = sorted((ROOT / "examples").glob("*.py"))
REDUCED = {
    "cleanrl_loop": (["--total-steps", "12800"], "12800 decisions: return"),
    "judge_policy": (["--episodes", "2", "--out", "judged"], "reference dt=0.05"),
    "own_environment": (["--episodes", "2", "--out", "windy"], "Mean return at home −"),
    "own_ppo": (["--total-steps", "4096", "--out", "own"], "integ-gym evaluate own/policy.zip"),
    "panel_from_python": (
        ["--total-steps", "4096", "--seeds", "2", "--out", "panel"],
        "symplectic_euler dt=0.05 → reference dt=0.05: not_learned",
    ),
    "read_evidence": (["--lanes", "4", "--out", "records"], "explicit_euler"),
}
"""Script to arguments that make it short, and what it then says."""


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_is_short_and_says_how_it_is_run(script):
    text = script.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 40
    assert f"python examples/{script.name}" in text


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_runs(script, tmp_path):
    arguments, said = REDUCED[script.stem]
    done = subprocess.run(
        [sys.executable, "-W", "error", script, *arguments],
        cwd=tmp_path, capture_output=True, text=True, check=False, timeout=500,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert said in done.stdout
