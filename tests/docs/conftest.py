"""Scripts of published experiments, imported as they are run."""

from __future__ import annotations

import importlib
import sys

import pytest
from house import ROOT

BENCHMARKS = ROOT / "benchmarks"


@pytest.fixture
def import_experiment(monkeypatch):
    """A function that imports an experiment's script by its name."""
    folders = (BENCHMARKS / "tables", BENCHMARKS)
    for folder in folders:
        monkeypatch.syspath_prepend(str(folder))
    before = set(sys.modules)
    yield importlib.import_module
    own = {"measuring", *(script.stem for folder in folders for script in folder.glob("*.py"))}
    for name in set(sys.modules) - before:
        if name.split(".")[0] in own:
            del sys.modules[name]
