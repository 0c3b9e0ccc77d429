"""What each target of the Makefile sets up, and that one adds to another."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent.parent
PANEL, TRAIN, REST = '".[panel]"', '".[panel,train]"', '".[all]" --group dev'


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, tmp_path)
    (tmp_path / ".venv").mkdir()
    return tmp_path


def _installed(clone: Path, target: str) -> list[str]:
    """What a target would install."""
    done = subprocess.run(
        ["make", "--dry-run", target], cwd=clone, check=True, capture_output=True, text=True
    )
    return re.findall(r"--editable (.*)", done.stdout)


def test_each_target_installs_what_it_needs(clone):
    assert _installed(clone, "panel") == [PANEL]
    assert _installed(clone, "train") == [PANEL, TRAIN]
    assert _installed(clone, "test") == [PANEL, TRAIN, REST]


def test_what_is_there_is_not_installed_again(clone):
    for name in (".panel", ".train", ".ready"):
        (clone / ".venv" / name).touch()
        os.utime(clone / ".venv" / name)
        assert _installed(clone, "panel") == []
    assert _installed(clone, "test") == []
    (clone / ".venv" / ".ready").unlink()
    assert _installed(clone, "test") == [REST]
    os.utime(clone / "constraints.txt", (4e9, 4e9))
    assert _installed(clone, "panel") == [PANEL]


def test_a_panel_brings_neither_torch_nor_an_engine():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    extras = tomllib.loads(text)["project"]["optional-dependencies"]

    def brought(extra: str) -> set[str]:
        found: set[str] = set()
        for requirement in extras[extra]:
            name, _, inner = requirement.partition(">")[0].partition("[")
            own = inner.rstrip("]").split(",") if name == "integ-gym" else []
            found |= set().union(*map(brought, own)) if own else {name}
        return found

    assert brought("panel") == {
        "duckdb", "jax", "jinja2", "matplotlib", "msgspec", "portalocker",
        "pyarrow", "safetensors",
        "scipy", "threadpoolctl", "rich",
    }  # fmt: skip
    assert {"torch", "stable-baselines3"} <= brought("train")
