"""What a page simulates in the browser is what was recorded."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from driving import Browser, driven

from integ_gym.evidence.store import EvidenceStore

pytestmark = pytest.mark.slow

SMALL = 1e-5  # rad
CARD = "document.querySelector('#watch-card')"
PANES = f"[...{CARD}.querySelectorAll('.pane')]"
SLIDER = "document.getElementById('watch-start')"
SEEN = "document.querySelector('.matrixcard .measure').textContent"
TOLD = """carried.leads.flatMap((lead) => {
  const like = carried.trace(...lead.at);
  return lead.cells.filter((c) => live.acts(lead.at[0], lead.at[2]) && live.steps(c)).map((c) => {
    const own = carried.trace(lead.at[0], c, lead.at[2], lead.at[3]);
    const made = live.trace(like, c, null);
    const motion = Object.values(made.motion).map((x) => [...x]);
    return [own.id, made.label === 'none', motion, made.totals];
  });
})"""


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with driven(tmp_path_factory.mktemp("browser")) as found:
        found.prefers(color_scheme="light", reduced_motion="reduce")
        yield found


def opened(browser: Browser, address: str) -> None:
    browser.open(address)
    browser.until("'ready' in document.documentElement.dataset")


@pytest.fixture
def report(browser: Browser, panel_directory: Path) -> str:
    browser.size(1440, 900)
    browser.said.clear()
    return (panel_directory / "report.html").as_uri()


def test_an_episode_recomputed_is_the_recorded_one(
    browser: Browser, panel_directory: Path, tmp_path: Path
) -> None:
    html = (panel_directory / "report.html").read_text("utf-8")
    html = re.sub(r"<meta http-equiv[^>]*>", "", html)
    unpacked = 'const carried = await unpack(document.getElementById("carried").textContent);'
    shown = html.replace(
        unpacked, f"{unpacked} Object.assign(globalThis, {{ carried, live: carried.live }});"
    )
    assert shown != html
    (tmp_path / "shown.html").write_text(shown, "utf-8")
    opened(browser, (tmp_path / "shown.html").as_uri())
    told = browser.value(TOLD)
    store = EvidenceStore(panel_directory / "evidence")
    assert len({record for record, *_ in told}) >= 4
    for record_id, success, motion, totals in told:
        record = store.find(record_id)
        np.testing.assert_allclose(motion[0], record.trace["theta"], rtol=0.0, atol=SMALL)
        assert success == record["success"]
        expected = [record["work_total"], record["energy_residual_total"]]
        np.testing.assert_allclose(totals[:2], expected, rtol=1e-4, atol=1e-4)


def test_the_start_is_moved_by_keys_and_stands_in_the_url(browser: Browser, report: str) -> None:
    opened(browser, report)
    recorded = browser.value(f"{PANES}.map((pane) => pane.innerText).join()")
    assert "recorded" in recorded
    assert "recomputed in this browser" not in recorded
    browser.value(f"{SLIDER}.focus()")
    browser.press(*["ArrowLeft"] * 6)
    assert browser.value(f"document.activeElement === {SLIDER}")
    panes = browser.value(f"{PANES}.map((pane) => pane.innerText)")
    assert all("recomputed in this browser" in pane for pane in panes)
    browser.until(
        f"{PANES}.every((pane) => pane.querySelector('.starts output').textContent.includes('%'))"
    )
    angle = browser.value("document.querySelector('.start .angle').textContent")
    place = browser.value("location.hash")
    assert re.search(r"a[\d.]+t3$", place)
    moved = browser.value(f"{PANES}.map((pane) => pane.querySelector('.bars').innerText).join()")
    opened(browser, report + place)
    assert browser.value("document.querySelector('.start .angle').textContent") == angle
    same = browser.value(f"{PANES}.map((pane) => pane.querySelector('.bars').innerText).join()")
    assert same == moved
    browser.value(f"{CARD}.querySelector('.start .chip').click()")
    assert browser.value(f"{PANES}.map((pane) => pane.innerText).join()") == recorded
    assert browser.said == []


def test_other_discretizations_are_simulated_too(browser: Browser, report: str) -> None:
    extra = f"[...{CARD}.querySelectorAll('.further .chip')]"
    opened(browser, report)
    leads = browser.value("document.getElementById('watch-policy').options.length")
    found = {}
    for lead in range(leads):
        opened(browser, f"{report}#w{lead}")
        found[lead] = browser.value(f"{extra}.map((chip) => chip.textContent)")
    lead = max(found, key=lambda one: len(found[one]))
    assert found[lead]
    opened(browser, f"{report}#w{lead}")
    browser.value(f"{CARD}.querySelector('.further').open = true")
    browser.value(f"{extra}[0].click()")
    told = browser.value(f"{PANES}.map((pane) => pane.querySelector('figcaption').innerText)")
    [pane] = [text for text in told if text.startswith(found[lead][0])]
    assert "recomputed in this browser" in pane


def test_the_matrix_stands_in_the_url(browser: Browser, report: str) -> None:
    opened(browser, report)
    chips = "document.querySelectorAll('.matrixcard .controls > .chips .chip')"
    browser.value(f"{chips}[1].click()")
    browser.value("document.querySelector('.matrixcard .filters').open = true")
    columns = "document.querySelectorAll('table.heat thead tr:last-child th:not([hidden])').length"
    browser.value("document.querySelector('.matrixcard .filters .chip').click()")
    words, count, place = (
        browser.value(SEEN),
        browser.value(columns),
        browser.value("location.hash"),
    )
    assert place == "#~m1g0"
    opened(browser, report + place)
    assert (browser.value(SEEN), browser.value(columns)) == (words, count)
    cell = "document.querySelector('table.heat a[href]:not([tabindex=\"-1\"])')"
    browser.value(f"{cell}.click()")
    browser.until("document.getElementById('drawer').open")
    browser.until("location.hash.endsWith('~m1g0')")
    assert browser.value("location.hash").startswith("#r")
    browser.press("Escape")
    browser.until("location.hash === '#~m1g0'")
    assert browser.value(SEEN) == words
    assert browser.said == []
