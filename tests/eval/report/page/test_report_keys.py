"""The page of a real panel in a real browser: keys, sizes, schemes, motion, energy."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from driving import Browser, driven
from house import ROOT

LOOKING = (ROOT / "tests" / "helpers" / "report" / "looking.js").read_text(encoding="utf-8")
WIDTHS = (1440, 1024, 390)
CELLS = "[...document.querySelectorAll('table.heat td > a')]"
FOCUSED = "document.activeElement"

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with driven(tmp_path_factory.mktemp("browser")) as found:
        yield found


@pytest.fixture
def page(panel_directory: Path, browser: Browser) -> Path:
    """The report of a finished panel; the browser is as at first."""
    browser.size(1440, 900)
    browser.prefers(color_scheme="light", reduced_motion="reduce")
    browser.said.clear()
    browser.asked.clear()
    return panel_directory / "report.html"


def opened(browser: Browser, page: Path, place: str = "") -> None:
    browser.open(page.as_uri() + place)
    browser.until("'ready' in document.documentElement.dataset")
    browser.value(LOOKING + "; 0")


@pytest.mark.parametrize("width", WIDTHS)
def test_from_a_cell_to_an_episode_and_back_by_keys_alone(
    width: int, browser: Browser, page: Path
) -> None:
    browser.size(width, 844, phone=width < 500)
    opened(browser, page)
    episode = browser.value("document.querySelector('#watch-card a').hash")
    cell = episode.partition("s")[0]
    row = f"[...document.querySelector('table.heat a[href=\"{cell}\"]').closest('tr').cells]"
    place = browser.value(f"{row}.findIndex((one) => one.querySelector('a[href=\"{cell}\"]'))")
    beside = place - 1 if place > 1 else place + 1
    browser.value(f"{row}[{beside}].querySelector('a').focus()")
    browser.press("ArrowRight" if beside < place else "ArrowLeft")
    assert browser.value(f"{FOCUSED}.hash") == cell
    browser.press("Enter")
    browser.until("document.getElementById('drawer').open")
    assert browser.value(f"{FOCUSED}.getAttribute('role')") == "gridcell"
    assert browser.value("location.hash") == cell
    browser.press("ArrowRight", "ArrowLeft", "Enter")
    browser.until("document.querySelector('#drawer .outcome') !== null")
    assert browser.value("location.hash").startswith(f"{cell}s")
    assert browser.value(f"{FOCUSED}.type") == "range"
    before = browser.value("document.querySelector('#drawer .cursor').getAttribute('x1')")
    browser.press(*["ArrowRight"] * 8)
    assert "t0.4" in browser.value("location.hash")
    assert before != browser.value("document.querySelector('#drawer .cursor').getAttribute('x1')")
    browser.press("Escape")
    browser.until("!document.getElementById('drawer').open")
    assert browser.value(f"{FOCUSED}.hash") == cell
    browser.until("location.hash === ''")
    assert browser.said == []
    assert browser.asked == ["about:blank", page.as_uri()][-len(browser.asked) :]


@pytest.mark.parametrize("width", WIDTHS)
def test_nothing_focused_is_covered_and_no_header_is_cut(
    width: int, browser: Browser, page: Path
) -> None:
    browser.size(width, 844, phone=width < 500)
    opened(browser, page)
    assert browser.value("looking.cut()") == []
    assert browser.value("document.documentElement.scrollWidth <= innerWidth")
    hidden = f"{CELLS}.filter((one) => {{ one.focus(); return looking.covered({FOCUSED}); }})"
    assert browser.value(f"{hidden}.map((one) => one.hash)") == []
    tabs = 0
    browser.value(f"scrollTo(0, 0); {FOCUSED}.blur()")
    while tabs < 120:
        browser.press("Tab")
        if browser.value(f"{FOCUSED} === document.body"):
            break
        tabs += 1
        assert not browser.value(f"looking.covered({FOCUSED})"), browser.value(
            f"{FOCUSED}.outerHTML.slice(0, 200)"
        )
    assert 10 < tabs < 100


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out(scheme: str, browser: Browser, page: Path) -> None:
    browser.prefers(color_scheme=scheme, reduced_motion="reduce")
    opened(browser, page)
    assert browser.value("looking.faint(4.5)") == []
    chips = "document.querySelectorAll('.matrixcard .controls > .chips .chip')"
    for measure in range(1, browser.value(f"{chips}.length")):
        browser.value(f"{chips}[{measure}].click()")
        assert browser.value("looking.faint(4.5)") == [], measure
    for place in ("#r0c0", "#r0c0s0e0"):
        opened(browser, page, place)
        assert browser.value("looking.faint(4.5)") == []


def test_nothing_moves_for_who_does_not_want_it(browser: Browser, page: Path) -> None:
    clock = "document.querySelector('#watch-card .clock').textContent"
    opened(browser, page)
    browser.value("document.getElementById('watch-card').scrollIntoView()")
    told = browser.value(clock)
    browser.value("new Promise((done) => setTimeout(done, 400))")
    assert browser.value(clock) == told
    browser.prefers(reduced_motion="no-preference")
    opened(browser, page)
    browser.value("document.getElementById('watch-card').scrollIntoView()")
    browser.until(f"{clock} !== '0.00 s'")
    button = "document.querySelector('#watch-card .play')"
    browser.value(f"{button}.textContent === 'Pause' && {button}.click()")
    told = browser.value(clock)
    browser.value("new Promise((done) => setTimeout(done, 400))")
    assert browser.value(clock) == told


def test_the_ledgers_bars_close(browser: Browser, page: Path) -> None:
    opened(browser, page)
    for place in browser.value(f"{CELLS}.map((cell) => cell.hash)")[::5]:
        browser.value(f"location.hash = '{place}s0e0'")
        browser.until("document.querySelector('#drawer .ledger') !== null")
        told = browser.value(
            "Object.fromEntries([...document.querySelectorAll('#drawer [data-ledger]')].map("
            "(line) => [line.dataset.ledger, line.querySelector('output').textContent]))"
        )
        joules = {
            name: float(text.replace("−", "-").removesuffix(" J")) for name, text in told.items()
        }
        change = joules.pop("change of energy")
        assert sum(joules.values()) == pytest.approx(change, abs=1e-9)


def test_a_link_says_what_is_open(browser: Browser, page: Path) -> None:
    opened(browser, page)
    episode = browser.value("document.querySelector('#watch-card a').hash")
    opened(browser, page, f"{episode}t1.5")
    assert browser.value("document.querySelector('#drawer .clock').textContent") == "1.50 s"
    start = f"start {episode.rpartition('e')[2]}"
    assert start in browser.value("document.querySelector('#drawer .crumb').textContent")
    opened(browser, page, "#w0t1.25")
    assert browser.value("document.querySelector('#watch-card .clock').textContent") == "1.25 s"
    chips = "document.querySelectorAll('#watch-card .chip')"
    assert browser.value(f"{chips}.length") > 1
    browser.value(f"{chips}[{chips}.length - 1].click()")
    assert browser.value("location.hash").startswith("#w0o")


def test_the_matrix_shows_other_measures_and_fewer_columns(browser: Browser, page: Path) -> None:
    opened(browser, page)
    words = "document.querySelector('.matrixcard .measure').textContent"
    texts = f"{CELLS}.map((cell) => cell.querySelector('b').textContent).join()"
    seen = {browser.value(texts): browser.value(words)}
    chips = "document.querySelectorAll('.matrixcard .controls > .chips .chip')"
    count = browser.value(f"{chips}.length")
    assert count >= 3
    for place in range(1, count):
        browser.value(f"{chips}[{place}].click()")
        seen[browser.value(texts)] = browser.value(words)
    assert len(seen) == len(set(seen.values())) == count
    columns = "document.querySelectorAll('table.heat thead tr:last-child th:not([hidden])').length"
    before = browser.value(columns)
    browser.value("document.querySelector('.filters .chip').click()")
    assert 0 < browser.value(columns) < before
    assert browser.said == []
