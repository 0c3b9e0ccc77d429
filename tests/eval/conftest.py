"""A finished small panel, run once."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path

import pytest
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


@pytest.fixture(scope="session")
def diagnosis(tmp_path_factory):
    """Directory, result and terminal output of a diagnosis of the pendulum, run once."""
    out = tmp_path_factory.mktemp("diagnose") / "run"
    names = ("symplectic_euler", "reference", "planted:Boaster", "planted:Silent")
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        code = main(
            ["diagnose", "--plant", "pendulum", "--integrator", *names,
             "--out", str(out), "--workers", "1", "--no-progress"]
        )  # fmt: skip
    assert code == 0
    result = json.loads((out / "diagnose.json").read_text(encoding="utf-8"))
    return out, result, printed.getvalue()
