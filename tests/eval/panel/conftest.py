"""The run that all others are held against, on one machine and undisturbed."""

from __future__ import annotations

from pathlib import Path

import pytest
from shared_panel import ended, started, words


@pytest.fixture(scope="session")
def undisturbed(made_once) -> Path:
    """Its directory."""

    def make(folder: Path) -> None:
        assert ended(started(words(folder, folder / "run"))) == 0

    return made_once("shared_panel", make) / "run"
