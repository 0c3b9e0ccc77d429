"""The notebooks: a question before every cell, figures as they were last run, and they run."""

from __future__ import annotations

import os

import nbformat
import pytest
from house import ROOT
from nbclient import NotebookClient

PATHS = {path.stem: path for path in sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))}
REDUCED = {"TOTAL_STEPS": "4096", "SEEDS": "2"}
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
    for variable, value in {**REDUCED, "RUN": str(tmp_path / "run")}.items():
        monkeypatch.setenv(variable, value)
    monkeypatch.delenv("MPLBACKEND", raising=False)
    notebook = nbformat.read(PATHS[name], as_version=4)
    made = NotebookClient(
        notebook, timeout=500, resources={"metadata": {"path": str(tmp_path)}}
    ).execute(env=dict(os.environ))
    for cell in made.cells:
        if "plt.show" in cell.source:
            assert any("image/png" in output.get("data", {}) for output in cell.outputs)
