"""How much a page weighs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from report_episodes import told_of
from report_example import base_panel, judge
from report_pages import Page, panel_from
from report_rows import EPISODES, SCHEMES, TRUTH, baselines, extra_cells, grid_cells, trained

from integ_gym.eval.panel.model.panel import Panel
from integ_gym.eval.report.page import render

STEPS = (0.05, 0.025, 0.0125)
MOST_BYTES, MOST_NODES = 1_200_000, 5_000


def _rows(count: int, seeds: int) -> list[dict[str, Any]]:
    """Rows of one integrator each, with names of their own."""
    steps = [0.05 / (k + 1) for k in range(-(-count // 3))]
    return [line for dt in steps for line in trained(SCHEMES[:3], seeds, dt)][:count]


def quick_size() -> Panel:
    """As many policies and cells as the quick panel has."""
    rows = [*_rows(3, 48), *_rows(7, 10)[3:], *baselines(1)]
    panel = base_panel(rows, [*grid_cells(SCHEMES[:4], STEPS), *extra_cells()], 7)
    pairs = [("explicit_euler dt=0.05", TRUTH), ("symplectic_euler dt=0.05", TRUTH)]
    panel["verdicts"] = judge(panel, [*pairs, ("rk4 dt=0.05", TRUTH)])
    return panel_from(panel)


def ten_times() -> Panel:
    """Ten times as many entries of the matrix."""
    steps = tuple(0.1 / (k + 1) for k in range(10))
    rows = [*_rows(3, 48), *_rows(24, 10)[3:], *baselines(1)]
    return panel_from(base_panel(rows, grid_cells(SCHEMES, steps), 7))


@pytest.mark.parametrize(("panel", "times"), [(quick_size, 1), (ten_times, 3)])
def test_a_page_stays_light(panel: Callable[[], Panel], times: int) -> None:
    made = panel()
    html = render(made, told_of(made, EPISODES))
    page = Page(html)
    nodes = len(page.tags)
    print(f"{len(html.encode()):,} bytes, {nodes:,} nodes, {len(made.matrix)} entries")
    assert len(html.encode()) <= times * MOST_BYTES
    assert nodes <= times * MOST_NODES
