"""How much a page weighs."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from driving import driven
from report_episodes import told_of
from report_example import base_panel, judge
from report_pages import Page, panel_from
from report_rows import EPISODES, SCHEMES, TRUTH, baselines, extra_cells, grid_cells, trained

from integ_gym.eval.panel.result import Panel
from integ_gym.eval.report.page import render

STEPS = (0.05, 0.025, 0.0125)
MOST_BYTES, MOST_NODES, MOST_MILLISECONDS = 1_200_000, 5_000, 1_000


def _rows(count: int, seeds: int) -> list[dict[str, Any]]:
    """Rows of one integrator each, with names of their own."""
    steps = [0.05 / (k + 1) for k in range(-(-count // 3))]
    return [line for dt in steps for line in trained(SCHEMES[:3], seeds, dt)][:count]


@cache
def quick_size() -> Panel:
    """As many policies and cells as the quick panel has."""
    rows = [*_rows(3, 56), *_rows(7, 10)[3:], *baselines(1)]
    panel = base_panel(rows, [*grid_cells(SCHEMES[:4], STEPS), *extra_cells()], 7)
    pairs = [("explicit_euler dt=0.05", TRUTH), ("symplectic_euler dt=0.05", TRUTH)]
    panel["verdicts"] = judge(panel, [*pairs, ("rk4 dt=0.05", TRUTH)])
    return panel_from(panel)


@cache
def ten_times() -> Panel:
    """Ten times as many entries of the matrix, 1 900 and more."""
    steps = tuple(0.1 / (k + 1) for k in range(14))
    rows = [*_rows(3, 56), *_rows(24, 10)[3:], *baselines(1)]
    panel = base_panel(rows, grid_cells(SCHEMES, steps), 7)
    panel["verdicts"] = judge(panel, [(f"{name} dt=0.05", TRUTH) for name in SCHEMES[:3]])
    return panel_from(panel)


@cache
def html_of(panel: Callable[[], Panel]) -> str:
    made = panel()
    return render(made, told_of(made, EPISODES))


both = pytest.mark.parametrize(("panel", "times"), [(quick_size, 1), (ten_times, 3)])


def test_one_has_ten_times_the_entries_of_the_quick_panel() -> None:
    assert len(ten_times().matrix) >= 10 * 190


@both
def test_a_page_stays_light(panel: Callable[[], Panel], times: int) -> None:
    html = html_of(panel)
    nodes = len(Page(html).tags)
    print(f"{len(html.encode()):,} bytes, {nodes:,} nodes")
    assert len(html.encode()) <= times * MOST_BYTES
    assert nodes <= times * MOST_NODES


@pytest.mark.slow
@both
def test_a_page_is_soon_there(panel: Callable[[], Panel], times: int, tmp_path: Path) -> None:
    """Simulation and all; the best of three, since others may work on the machine."""
    (tmp_path / "page.html").write_text(html_of(panel), "utf-8")
    taken = []
    with driven(tmp_path) as browser:
        for _ in range(3):
            browser.open((tmp_path / "page.html").as_uri())
            browser.until("'ready' in document.documentElement.dataset")
            taken.append(browser.value("Number(document.documentElement.dataset.ready)"))
            nodes = browser.value("document.querySelectorAll('*').length")
        assert browser.said == []
    print(f"{min(taken):g} ms, {nodes:,} nodes")
    assert min(taken) <= times * MOST_MILLISECONDS
    assert nodes <= times * MOST_NODES
