"""The scripts in ``examples`` are short and run as they stand, here for a few steps."""

import os
import subprocess
import sys

import nbformat
import pytest
from house import ROOT
from nbclient import NotebookClient

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


PATHS = {path.stem: path for path in sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))}
REDUCED_NOTEBOOK = {"TOTAL_STEPS": "4096", "SEEDS": "2"}
"""What makes the panel of *explain* small."""


@pytest.mark.parametrize("name", PATHS)
def test_what_came_of_every_cell_is_kept(name):
    """With titles and axes in the pictures, which people read without running anything."""
    for cell in nbformat.read(PATHS[name], as_version=4).cells:
        if cell.cell_type == "code":
            assert cell.outputs
            assert all(output.output_type != "error" for output in cell.outputs)
            assert ("plt.subplots" in cell.source) == ("set_title" in cell.source)
            assert str(ROOT) not in str(cell.outputs)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of Jupyter's own event loop
@pytest.mark.parametrize("name", PATHS)
def test_a_notebook_runs(name, tmp_path, monkeypatch):
    for variable, value in {**REDUCED_NOTEBOOK, "RUN": str(tmp_path / "run")}.items():
        monkeypatch.setenv(variable, value)
    monkeypatch.delenv("MPLBACKEND", raising=False)
    notebook = nbformat.read(PATHS[name], as_version=4)
    made = NotebookClient(
        notebook, timeout=500, resources={"metadata": {"path": str(tmp_path)}}
    ).execute(env=dict(os.environ))
    for cell in made.cells:
        if "plt.show" in cell.source:
            assert any("image/png" in output.get("data", {}) for output in cell.outputs)
