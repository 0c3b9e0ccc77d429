"""Finished runs that tests read, or change in a copy of their own."""

import shutil
from pathlib import Path

import pytest
from shared_panel import ended, started, words
from small_panel import TINY

from integ_gym.cli import main


@pytest.fixture(scope="session")
def undisturbed(made_once) -> Path:
    """The run that all others are held against, on one machine and undisturbed."""

    def make(folder: Path) -> None:
        assert ended(started(words(folder, folder / "run"))) == 0

    return made_once("shared_panel", make) / "run"


@pytest.fixture(scope="session")
def tiny_panel(made_once) -> Path:
    """Directory of a finished run of the tiny panel, beside its specification."""

    def make(folder: Path) -> None:
        spec = folder / "tiny.toml"
        spec.write_text(TINY, encoding="utf-8")
        given = ["--out", str(folder / "out"), "--workers", "1", "--no-progress"]
        assert main(["panel", str(spec), *given]) == 0

    return made_once("tiny_panel", make) / "out"


@pytest.fixture
def run(tiny_panel, tmp_path) -> Path:
    """A copy of it."""
    return shutil.copytree(tiny_panel, tmp_path / "run")


@pytest.fixture
def again(tiny_panel):
    """A function that runs the tiny panel in a directory, with further words; its exit code."""

    def run_again(out: Path, *further: str) -> int:
        command = ["panel", str(tiny_panel.parent / "tiny.toml"), "--out", str(out)]
        return main([*command, "--workers", "1", "--no-progress", *further])

    return run_again
