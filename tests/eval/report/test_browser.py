"""The page of a real panel in a real browser: keys, sizes, schemes, links, films, simulation."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from driving import Browser, assert_fits
from house import ROOT
from report_pages import PANELS, panel_of, pixels

from integ_gym.eval.report.page import render, write_report
from integ_gym.evidence.store import EvidenceStore

pytestmark = pytest.mark.slow

LOOKING = (ROOT / "tests" / "helpers" / "report" / "looking.js").read_text(encoding="utf-8")
WIDTHS = (1440, 390)
SMALL = 1e-5  # rad
CARD = "document.querySelector('#watch-card')"
DRAWER = "document.getElementById('drawer')"
CELLS = "[...document.querySelectorAll('table.heat td > a')]"
CHIPS = "document.querySelectorAll('.matrixcard .controls > .chips .chip')"
COLUMNS = "document.querySelectorAll('table.heat thead tr:last-child th:not([hidden])').length"
MEASURE = "document.querySelector('.matrixcard .measure').textContent"
PANES = f"[...{CARD}.querySelectorAll('.pane')]"
SLIDER = "document.getElementById('watch-start')"
BUTTON = f"{CARD}.querySelector('.play')"
CLOCK = f"{CARD}.querySelector('.clock').textContent"
EPISODE = f"{CARD}.querySelector('.legend a')"
FOCUSED = "document.activeElement"
HASH = "location.hash"
WAIT = "new Promise((done) => setTimeout(done, 300))"
RECOMPUTED = """carried.leads.flatMap((lead) => {
  const like = carried.trace(...lead.at);
  return lead.cells.filter((c) => live.acts(lead.at[0], lead.at[2]) && live.steps(c)).map((c) => {
    const own = carried.trace(lead.at[0], c, lead.at[2], lead.at[3]);
    const made = live.trace(like, c, null);
    const motion = Object.values(made.motion).map((x) => [...x]);
    return [own.id, made.label === 'none', motion, made.totals];
  });
})"""


def look(browser: Browser, address: str) -> None:
    """Open a report, and make ready what looks at it."""
    browser.open_report(address)
    browser.value(LOOKING + "; 0")


def test_pages_fit_a_desktop_and_a_phone(tmp_path: Path) -> None:
    assert_fits(tmp_path, {name: render(panel_of(name)) for name in PANELS})


def test_the_page_is_drawn_in_both_schemes_and_with_forced_colours(
    browser: Browser, tmp_path: Path
) -> None:
    """Where grounds are taken away cells have borders, and homes wider ones."""
    address = write_report(panel_of("full"), tmp_path).as_uri()
    for scheme in ("light", "dark"):
        browser.prefers(color_scheme=scheme)
        browser.open_report(address)
        browser.picture(tmp_path / "shot.png")
        image = pixels(tmp_path / "shot.png")
        assert image[5, 5].mean() > 0.8 if scheme == "light" else image[5, 5].mean() < 0.2
        assert np.any(np.abs(image - image[5, 5]) > 0.1, axis=-1).mean() > 0.05
    browser.forces_colours()
    browser.open_report(f"{address}#r1c2")
    widths = ".map((e) => parseFloat(getComputedStyle(e).borderTopWidth))"
    for kind, width in (("td > a:not(.home)", 1), ("a.home", 3)):
        cells = f"[...document.querySelectorAll('table.heat {kind}')]"
        assert set(browser.value(cells + widths)) == {width}
    assert browser.value(f"{DRAWER}.open")
    words = browser.value(f"{DRAWER}.innerText")
    assert "loss against home" in words
    assert "This page carries no episodes of this cell." in words
    assert browser.said == []


@pytest.mark.parametrize("width", WIDTHS)
def test_from_a_cell_to_an_episode_and_back_by_keys_alone(
    width: int, browser: Browser, report: str
) -> None:
    browser.size(width, 844, phone=width < 500)
    look(browser, report)
    cell = browser.value(f"{EPISODE}.hash").partition("s")[0]
    row = f"[...document.querySelector('table.heat a[href=\"{cell}\"]').closest('tr').cells]"
    place = browser.value(f"{row}.findIndex((one) => one.querySelector('a[href=\"{cell}\"]'))")
    beside = place - 1 if place > 1 else place + 1
    browser.value(f"{row}[{beside}].querySelector('a').focus()")
    browser.press("ArrowRight" if beside < place else "ArrowLeft")
    assert browser.value(f"{FOCUSED}.hash") == cell
    browser.press("Enter")
    browser.until(f"{DRAWER}.open")
    assert browser.value(f"{FOCUSED}.getAttribute('role')") == "gridcell"
    assert browser.value(HASH) == cell
    browser.press("ArrowRight", "ArrowLeft", "Enter")
    browser.until("document.querySelector('#drawer .outcome') !== null")
    assert browser.value(HASH).startswith(f"{cell}s")
    assert browser.value(f"{FOCUSED}.type") == "range"
    cursor = "document.querySelector('#drawer .cursor').getAttribute('x1')"
    before = browser.value(cursor)
    browser.press(*["ArrowRight"] * 8)
    assert "t0.4" in browser.value(HASH)
    assert before != browser.value(cursor)
    browser.press("Escape")
    browser.until(f"!{DRAWER}.open && {HASH} === ''")
    assert browser.value(f"{FOCUSED}.hash") == cell
    assert browser.said == []
    assert browser.asked == ["about:blank", report][-len(browser.asked) :]


@pytest.mark.parametrize("width", WIDTHS)
def test_nothing_focused_is_covered_and_no_header_is_cut(
    width: int, browser: Browser, report: str
) -> None:
    browser.size(width, 844, phone=width < 500)
    look(browser, report)
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
def test_text_stands_out(scheme: str, browser: Browser, report: str) -> None:
    browser.prefers(color_scheme=scheme, reduced_motion="reduce")
    look(browser, report)
    assert browser.value("looking.faint(4.5)") == []
    for measure in range(1, browser.value(f"{CHIPS}.length")):
        browser.value(f"{CHIPS}[{measure}].click()")
        assert browser.value("looking.faint(4.5)") == [], measure
    for place in ("#r0c0", "#r0c0s0e0"):
        look(browser, report + place)
        assert browser.value("looking.faint(4.5)") == []


def test_films_move_for_who_wants_it_and_where_they_are_seen(browser: Browser, report: str) -> None:
    """What runs by itself leaves the address alone, and stops under an open drawer."""
    browser.open_report(report)
    browser.value(f"{CARD}.scrollIntoView()")
    time = browser.value(CLOCK)
    browser.value(WAIT)
    assert browser.value(CLOCK) == time
    browser.prefers(reduced_motion="no-preference")
    browser.open_report(report)
    browser.value(f"{CARD}.scrollIntoView()")
    browser.until(f"{CLOCK} !== '0.00 s'")
    assert browser.value(HASH) == ""
    browser.value(f"{BUTTON}.textContent === 'Pause' || {BUTTON}.click()")
    cell = browser.value(f"{EPISODE}.hash").partition("s")[0]
    browser.value(f"location.hash = '{cell}'")
    browser.until(f"{DRAWER}.open")
    assert browser.value(f"{BUTTON}.textContent") == "Play"
    time = browser.value(CLOCK)
    browser.value(WAIT)
    assert (browser.value(HASH), browser.value(CLOCK)) == (cell, time)
    assert browser.said == []


def test_the_ledgers_bars_close(browser: Browser, report: str) -> None:
    browser.open_report(report)
    for place in browser.value(f"{CELLS}.map((cell) => cell.hash)")[::5]:
        browser.value(f"location.hash = '{place}s0e0'")
        browser.until("document.querySelector('#drawer .ledger') !== null")
        shown = browser.value(
            "Object.fromEntries([...document.querySelectorAll('#drawer [data-ledger]')].map("
            "(line) => [line.dataset.ledger, line.querySelector('output').textContent]))"
        )
        joules = {
            name: float(text.replace("−", "-").removesuffix(" J")) for name, text in shown.items()
        }
        change = joules.pop("change of energy")
        assert sum(joules.values()) == pytest.approx(change, abs=1e-9)


def test_a_link_says_what_is_open(browser: Browser, report: str) -> None:
    browser.open_report(report)
    episode = browser.value(f"{EPISODE}.hash")
    browser.open_report(f"{report}{episode}t1.5")
    assert browser.value("document.querySelector('#drawer .clock').textContent") == "1.50 s"
    start = f"start {episode.rpartition('e')[2]}"
    assert start in browser.value("document.querySelector('#drawer .crumb').textContent")
    browser.open_report(f"{report}#w0t1.25")
    assert browser.value(CLOCK) == "1.25 s"
    chips = f"{CARD}.querySelectorAll('.chip')"
    assert browser.value(f"{chips}.length") > 1
    browser.value(f"{chips}[{chips}.length - 1].click()")
    assert browser.value(HASH).startswith("#w0o")


def test_the_matrix_shows_other_measures_and_fewer_columns_and_stands_in_the_url(
    browser: Browser, report: str
) -> None:
    browser.open_report(report)
    texts = f"{CELLS}.map((cell) => cell.querySelector('b').textContent).join()"
    seen, columns = {}, browser.value(COLUMNS)
    count = browser.value(f"{CHIPS}.length")
    for place in reversed(range(count)):
        browser.value(f"{CHIPS}[{place}].click()")
        seen[browser.value(texts)] = browser.value(MEASURE)
    assert len(seen) == len(set(seen.values())) == count >= 3
    browser.value(f"{CHIPS}[1].click()")
    browser.value("document.querySelector('.matrixcard .filters').open = true")
    browser.value("document.querySelector('.matrixcard .filters .chip').click()")
    shown = [browser.value(MEASURE), browser.value(COLUMNS)]
    assert 0 < shown[1] < columns
    assert browser.value(HASH) == "#~m1g0"
    browser.open_report(f"{report}#~m1g0")
    assert [browser.value(MEASURE), browser.value(COLUMNS)] == shown
    browser.value("document.querySelector('table.heat a[href]:not([tabindex=\"-1\"])').click()")
    browser.until(f"{DRAWER}.open && {HASH}.endsWith('~m1g0')")
    assert browser.value(HASH).startswith("#r")
    browser.press("Escape")
    browser.until(f"{HASH} === '#~m1g0'")
    assert browser.value(MEASURE) == shown[0]
    assert browser.said == []


def test_an_episode_recomputed_is_the_recorded_one(
    browser: Browser, panel_directory: Path, tmp_path: Path
) -> None:
    html = (panel_directory / "report.html").read_text("utf-8")
    unpacked = 'const carried = await unpack(document.getElementById("carried").textContent);'
    assert unpacked in html
    shown = f"{unpacked} Object.assign(globalThis, {{ carried, live: carried.live }});"
    html = re.sub(r"<meta http-equiv[^>]*>", "", html).replace(unpacked, shown)
    (tmp_path / "shown.html").write_text(html, "utf-8")
    browser.open_report((tmp_path / "shown.html").as_uri())
    episodes = browser.value(RECOMPUTED)
    store = EvidenceStore(panel_directory / "evidence")
    assert len({record for record, *_ in episodes}) >= 4
    for record_id, success, motion, totals in episodes:
        record = store.find(record_id)
        np.testing.assert_allclose(motion[0], record.trace["theta"], rtol=0.0, atol=SMALL)
        assert success == record["success"]
        expected = [record["work_total"], record["energy_residual_total"]]
        np.testing.assert_allclose(totals[:2], expected, rtol=1e-4, atol=1e-4)


def test_the_start_is_moved_by_keys_and_stands_in_the_url(browser: Browser, report: str) -> None:
    browser.open_report(report)
    bars = f"{PANES}.map((pane) => pane.querySelector('.bars').innerText).join()"
    recorded = browser.value(f"{PANES}.map((pane) => pane.innerText).join()")
    assert "recomputed in this browser" not in recorded
    browser.value(f"{SLIDER}.focus()")
    browser.press(*["ArrowLeft"] * 6)
    assert browser.value(f"{FOCUSED} === {SLIDER}")
    panes = browser.value(f"{PANES}.map((pane) => pane.innerText)")
    assert all("recomputed in this browser" in pane for pane in panes)
    browser.until(
        f"{PANES}.every((pane) => pane.querySelector('.starts output').textContent.includes('%'))"
    )
    angle = "document.querySelector('.start .angle').textContent"
    shown, place = [browser.value(angle), browser.value(bars)], browser.value(HASH)
    assert re.search(r"a[\d.]+t3$", place)
    browser.open_report(report + place)
    assert [browser.value(angle), browser.value(bars)] == shown
    browser.value(f"{CARD}.querySelector('.start .chip').click()")
    assert browser.value(f"{PANES}.map((pane) => pane.innerText).join()") == recorded
    assert browser.said == []


BEYOND = ("#r0c0s99e99", "#r0c0s0e99", "#r99c99", "#r99c99s1e1", "#w99o77.3t1.2.3", "#w0a999", "#%",
          "#r0c0t1.2.3", "#~m9g7d8")  # fmt: skip


def test_a_link_beyond_what_is_there_does_no_harm(browser: Browser, report: str) -> None:
    for place in BEYOND:
        browser.open_report(report + place)
        assert browser.value(f"{DRAWER}.open") == place.startswith("#r0c0"), place
        assert browser.value(f"{PANES}.length") >= 1
        assert "NaN" not in browser.value("document.body.innerText"), place
    assert browser.said == []
