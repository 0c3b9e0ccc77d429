"""A finished small panel, run once."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from small_panel import TOML

from integ_gym.cli import main


@pytest.fixture(scope="session")
def panel_directory(tmp_path_factory) -> Path:
    """Directory of a finished run of the small panel."""
    folder = tmp_path_factory.mktemp("panel")
    (folder / "small.toml").write_text(TOML, encoding="utf-8")
    out = folder / "out"
    assert main(["panel", str(folder / "small.toml"), "--out", str(out), "--no-progress"]) == 0
    return out
