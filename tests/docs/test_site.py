"""The site: it is built in strict mode, is complete, asks nobody, and is searched from a file."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import driving
import pytest
from house import ROOT

import integ_gym
from integ_gym.cli import COMMANDS

pytestmark = pytest.mark.slow
PAGES = (
    "index.html", "tutorials/play.html", "reference/panel.html", "reference/commands.html",
    "reference/api/training.html", "reference/api/catalogue.html", "explanation/trust.html",
)  # fmt: skip


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """What `make docs` builds, in another folder."""
    out = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--site-dir", str(out)],
        cwd=ROOT, capture_output=True, text=True, check=False,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "WARNING" not in done.stderr
    return out


@pytest.fixture
def page(tmp_path, monkeypatch):
    """A browser that may not read files from files, as a reader's may not."""
    closed = [flag for flag in driving.FLAGS if flag != "--allow-file-access-from-files"]
    monkeypatch.setattr(driving, "FLAGS", tuple(closed))
    with driving.driven(tmp_path) as opened:
        yield opened


def test_every_public_name_has_its_place(site):
    api = "".join(path.read_text("utf-8") for path in (site / "reference" / "api").glob("*.html"))
    for name in integ_gym.__all__:
        value = getattr(integ_gym, name)
        paths = [f"integ_gym.{name}"]
        if hasattr(value, "__path__"):
            paths = [f"{value.__name__}.{inner}" for inner in value.__all__]
        for path in paths:
            assert f'id="{path}"' in api, path
    for stem in integ_gym.ENVIRONMENTS.values():
        assert f'id="{stem.replace(":", ".")}Env"' in api
    commands = (site / "reference" / "commands.html").read_text("utf-8")
    assert all(f"{command.purpose[1:]}.</p>" in commands for command in COMMANDS.values())


def test_no_page_asks_anybody_else(site, page):
    for path in site.rglob("*.html"):
        loaded = re.findall(r'<(?:script|link|img|iframe)[^>]+(?:src|href)="(https?:[^"]+)"',
                            path.read_text("utf-8"))  # fmt: skip
        assert loaded == [], path.name
    for name in PAGES:
        page.open((site / name).as_uri())
    assert [to for to in page.asked if not to.startswith(("file:", "data:", "about:"))] == []
    assert page.said == []


@pytest.mark.parametrize("width", [390, 1440])
def test_pages_are_as_wide_as_the_screen(site, page, width):
    page.size(width, 900, phone=width < 500)
    for name in PAGES:
        page.open((site / name).as_uri())
        assert page.value("document.documentElement.scrollWidth") == width, name


def test_it_is_searched_from_a_file(site, page):
    page.open((site / "index.html").as_uri())
    page.value(
        "(() => { const field = document.querySelector('.md-search__input'); field.focus();"
        "field.value = 'overfitting';"
        "field.dispatchEvent(new Event('keyup', {bubbles: true})); })()"
    )
    page.until("document.querySelectorAll('.md-search-result__item').length > 1")
    found = page.value("document.querySelector('.md-search-result__list').innerText")
    assert "Panels" in found
