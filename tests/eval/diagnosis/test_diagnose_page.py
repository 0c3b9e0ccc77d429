"""The page of a diagnosis in a real browser: figures that can be read, and seen whole."""

from __future__ import annotations

from pathlib import Path

import pytest
from driving import driven

BOXES = "[...document.querySelectorAll('figure .scroll')]"
WORDS = "[...document.querySelectorAll('figcaption .aside')]"
FADES = f"{BOXES}.map((box) => parseFloat(getComputedStyle(box).getPropertyValue('--more')))"

pytestmark = pytest.mark.slow


@pytest.fixture
def page(diagnosis, tmp_path: Path):
    """A browser, and the address of a finished diagnosis's page."""
    with driven(tmp_path) as browser:
        yield browser, (diagnosis[0] / "diagnose.html").as_uri()


def test_a_phone_scrolls_figures_and_is_told_so(page):
    browser, address = page
    browser.size(390, 844, phone=True)
    browser.open(address)
    assert browser.value("document.documentElement.scrollWidth") == 390
    assert browser.value(f"{BOXES}.every((box) => box.scrollWidth > 1.5 * box.clientWidth)")
    assert browser.value(f"{WORDS}.every((words) => words.offsetHeight > 0)")
    if browser.value("CSS.supports('animation-timeline: scroll(self inline)')"):
        browser.until(f"{FADES}.every((fade) => fade > 20)")
        browser.value(f"{BOXES}.forEach((box) => box.scrollTo(box.scrollWidth, 0))")
        browser.until(f"{FADES}.every((fade) => fade === 0)")
    assert browser.said == []


def test_a_desktop_shows_them_whole(page):
    browser, address = page
    browser.size(1440, 900)
    browser.open(address)
    assert browser.value(f"{BOXES}.every((box) => box.scrollWidth === box.clientWidth)")
    assert browser.value(f"{WORDS}.every((words) => words.offsetHeight === 0)")
