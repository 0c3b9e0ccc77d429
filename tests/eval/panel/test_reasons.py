"""Reasons are sentences with the numbers that a panel stores, made where they are shown."""

from __future__ import annotations

import json
from typing import Any

import msgspec
import pytest
import report_example
from report_example import IMPOSSIBLE, SLOW, TRUTH, UNKNOWN

from integ_gym.eval.panel.conclusions import (
    comparison_reason,
    remedy_summary,
    solvable_reason,
    verdict_reason,
)
from integ_gym.eval.panel.result import Panel


def panel_of(raw: dict[str, Any]) -> Panel:
    return msgspec.json.decode(json.dumps(raw), type=Panel)


@pytest.fixture(scope="module")
def panel() -> Panel:
    return panel_of(report_example.full_panel())


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        ("explicit_euler dt=0.05", "Policies trained there: success from 100 % of the starts"),
        (IMPOSSIBLE, "energy of 19.6 J from 0 % of the starts within 20 s (at most 15.1 J)"),
        (SLOW, "The hand-made controller: success from 52 % of the starts within two horizons"),
        (UNKNOWN, "at most 26 %, by the hand-made controller; no search rules the goal out"),
    ],
)
def test_why_a_cell_can_or_cannot_be_solved(panel: Panel, cell: str, words: str) -> None:
    assert words in solvable_reason(panel, panel.cell(cell))


def test_why_a_verdict_is_what_it_is(panel: Panel) -> None:
    reasons = {(one.row, one.cell): verdict_reason(panel, one) for one in panel.verdicts}
    few = reasons["explicit_euler dt=0.05", TRUTH]
    for words in ("5 seeds and 5 native", "at least 33 seeds", "1.00 at home and 0.35 there"):
        assert words in few
    assert "0.00 is below 0.5" in reasons["implicit_euler dt=0.05", TRUTH]
    assert "at most 15.1 J" in reasons["rk4 dt=0.05", IMPOSSIBLE]
    many = panel_of(report_example.every_verdict_panel())
    words = {one.verdict: verdict_reason(many, one) for one in many.verdicts}
    assert words["fails"].startswith("Overfitting is above 0.2 (adjusted p < 0.001, 48 seeds")
    assert words["transfers"].startswith("Overfitting is within ±0.1 (adjusted p = 0.0")


def test_until_all_seeds_are_here_nothing_is_decided(panel: Panel) -> None:
    early = panel_of({**report_example.full_panel(), "stage": {"seeds": 1, "of": 3}})
    assert "1 of 3 training seeds" in verdict_reason(early, early.verdicts[0])
    assert "1 of 3 training seeds" in early.headline
    assert "1 of 3 training seeds" in early.warnings[-1]
    assert panel.warnings == ()


def test_why_a_comparison_ends_as_it_does(panel: Panel) -> None:
    lost, won = (comparison_reason(panel, one) for one in panel.policy_comparisons)
    assert lost.startswith("The win is not significant on rk4 dt=0.0125")
    assert won.startswith("A wins on rk4 dt=0.0125: A − B is 0.86")
    assert "on the truth" in won
    assert "no sign reverses in 3 informative cells" in won


def test_what_a_remedy_comes_to(panel: Panel) -> None:
    (remedy,) = panel.remedies
    assert "On the truth they succeed in 94 %" in remedy_summary(panel, remedy)
    raw = report_example.full_panel()
    next(row for row in raw["rows"] if row["name"] == remedy.row)["learned"] = False
    assert "did not learn" in remedy_summary(panel_of(raw), remedy)
    nowhere = msgspec.structs.replace(remedy, cells=())
    assert "nothing for mixed steps to remedy" in remedy_summary(panel, nowhere)


def test_the_reference_is_called_the_truth(panel: Panel) -> None:
    heavy = f"{TRUTH}, mass +20 %"
    assert [panel.label(name) for name in (TRUTH, heavy, "rk4 dt=0.05", "?")] == [
        "truth", "truth, mass +20 %", "rk4 dt=0.05", "?",
    ]  # fmt: skip
    assert panel.label(TRUTH, "the truth") == "the truth"
