"""One browser for all tests of pages."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from driving import Browser, driven


@pytest.fixture(scope="session")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with driven(tmp_path_factory.mktemp("browser")) as found:
        yield found


@pytest.fixture
def browser(chromium: Browser) -> Browser:
    """As wide as a desktop, in light colours, without motion."""
    chromium.size(1440, 900)
    chromium.prefers(color_scheme="light", reduced_motion="reduce")
    chromium.said.clear()
    chromium.asked.clear()
    return chromium


@pytest.fixture
def report(panel_directory: Path) -> str:
    """Address of a finished panel's page."""
    return (panel_directory / "report.html").as_uri()
