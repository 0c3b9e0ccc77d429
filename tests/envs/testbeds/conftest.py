"""Where tests of robots act."""

import pytest
from engine_cases import needs
from house import ROOT


@pytest.fixture
def robots_found(tmp_path, monkeypatch):
    """With MuJoCo, in a folder of its own, where the robots of the examples are found."""
    needs("mujoco")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(ROOT))
