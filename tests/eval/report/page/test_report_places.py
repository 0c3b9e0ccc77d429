"""Where the reader is, and where closing, links and films lead."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from driving import Browser, driven

pytestmark = pytest.mark.slow

DRAWER = "document.getElementById('drawer')"
CARD = "document.querySelector('#watch-card')"
BUTTON = f"{CARD}.querySelector('.play')"
CLOCK = f"{CARD}.querySelector('.clock').textContent"
FOCUSED = "document.activeElement"
HASH = "location.hash"


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with driven(tmp_path_factory.mktemp("browser")) as found:
        yield found


@pytest.fixture
def report(browser: Browser, panel_directory: Path) -> str:
    browser.size(1440, 900)
    browser.prefers(color_scheme="light", reduced_motion="reduce")
    browser.said.clear()
    return (panel_directory / "report.html").as_uri()


def opened(browser: Browser, address: str) -> None:
    browser.open(address)
    browser.until("'ready' in document.documentElement.dataset")


def an_episode(browser: Browser) -> str:
    """Place of an episode whose policy the page simulates."""
    place: str = browser.value(f"{CARD}.querySelector('.legend a').hash")
    return place


def test_a_film_that_runs_by_itself_leaves_the_address_alone(browser: Browser, report: str) -> None:
    browser.prefers(reduced_motion="no-preference")
    opened(browser, report)
    browser.value(f"{CARD}.scrollIntoView()")
    browser.until(f"{CLOCK} !== '0.00 s'")
    browser.until(f"{BUTTON}.textContent === 'Play'")
    assert browser.value(HASH) == ""
    browser.value(f"{BUTTON}.click()")
    browser.until(f"{CLOCK} !== '0.00 s'")
    browser.value(f"{BUTTON}.click()")
    assert browser.value(HASH).startswith("#w0")


def test_nothing_plays_under_an_open_drawer(browser: Browser, report: str) -> None:
    browser.prefers(reduced_motion="no-preference")
    opened(browser, report)
    browser.value(f"{CARD}.scrollIntoView()")
    browser.until(f"{BUTTON}.textContent === 'Pause'")
    cell = an_episode(browser).partition("s")[0]
    browser.value(f"location.hash = '{cell}'")
    browser.until(f"{DRAWER}.open")
    assert browser.value(f"{BUTTON}.textContent") == "Play"
    told = browser.value(CLOCK)
    browser.value("new Promise((done) => setTimeout(done, 300))")
    assert (browser.value(HASH), browser.value(CLOCK)) == (cell, told)
    assert browser.said == []


def test_the_way_from_an_episode_to_its_simulation_leaves_the_drawer(
    browser: Browser, report: str
) -> None:
    opened(browser, report)
    episode = an_episode(browser)
    opened(browser, report + episode)
    browser.value(f"{DRAWER}.querySelector('a[href^=\"#w\"]').click()")
    browser.until(f"!{DRAWER}.open")
    place = browser.value(HASH)
    assert place.startswith("#w")
    panes = browser.value(f"[...{CARD}.querySelectorAll('.pane')].map((pane) => pane.innerText)")
    assert len(panes) == 2
    assert "trained here" in panes[0]
    assert browser.value(f"{FOCUSED}.id") == "watch-start"
    browser.value("new Promise((done) => setTimeout(done, 300))")
    assert browser.value(HASH) == place
    assert browser.said == []


def test_escape_leads_back_to_where_the_reader_was(browser: Browser, report: str) -> None:
    opened(browser, report)
    browser.value(f"{CARD}.querySelector('.legend a').focus()")
    episode = an_episode(browser)
    browser.press("Enter")
    browser.until(f"{DRAWER}.open")
    browser.press("Escape")
    browser.until(f"!{DRAWER}.open && {HASH} === ''")
    assert browser.value(f"{FOCUSED} === {CARD}.querySelector('.legend a')")
    opened(browser, report + episode)
    browser.press("Escape")
    browser.until(f"!{DRAWER}.open && {HASH} === ''")
    assert browser.value(f"{FOCUSED}.hash") == episode.partition("s")[0]


@pytest.mark.parametrize(
    "place",
    ["#r0c0s99e99", "#r0c0s0e99", "#r99c99", "#r99c99s1e1", "#w99o77.3t1.2.3", "#w0a999", "#%",
     "#r0c0t1.2.3", "#~m9g7d8"],
)  # fmt: skip
def test_a_link_beyond_what_is_there_does_no_harm(
    place: str, browser: Browser, report: str
) -> None:
    opened(browser, report + place)
    assert browser.value(f"{DRAWER}.open") == place.startswith("#r0c0")
    assert browser.value(f"{CARD}.querySelectorAll('.pane').length") >= 1
    assert "NaN" not in browser.value("document.body.innerText")
    assert browser.said == []


def test_a_film_is_printed_as_it_ends_with_what_it_shows(browser: Browser, report: str) -> None:
    caption = f"{CARD}.querySelector('.caption').textContent"
    browser.prefers(reduced_motion="no-preference")
    opened(browser, report)
    browser.value("dispatchEvent(new Event('beforeprint'))")
    end = browser.value(f"Number({CARD}.querySelector('.clockwork input').max).toFixed(2)")
    assert browser.value(caption).endswith(f" · at {end} s")
    assert "seed" in browser.value(caption)
    browser.value("dispatchEvent(new Event('afterprint'))")
    assert " · at " not in browser.value(caption)


def test_a_cell_begins_with_its_numbers_and_its_worst_seed(browser: Browser, report: str) -> None:
    opened(browser, report)
    cell = an_episode(browser).partition("s")[0]
    opened(browser, report + cell)
    parts = f"[...{DRAWER}.querySelectorAll('.summary, .facts, .episodes')]"
    assert browser.value(f"{parts}.map((part) => part.className)") == [
        "summary", "episodes", "facts",
    ]  # fmt: skip
    assert browser.value(f"{parts}[0].textContent").startswith("success ")
    rows = f"[...{DRAWER}.querySelectorAll('.episodes [role=row]')]"
    heads = browser.value(f"{rows}.map((row) => row.firstChild.textContent)")
    assert len(heads) == len(set(heads)) > 1
    assert any("◆" in head for head in heads)
    assert browser.said == []
