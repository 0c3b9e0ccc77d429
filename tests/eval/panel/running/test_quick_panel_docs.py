"""docs/explanation/quick_panel.md says what was saved, and a new run agrees."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from integ_gym.eval.panel.run import run_panel
from integ_gym.eval.panel.spec import read_spec

ROOT = Path(__file__).parents[4]
SUMMARY = json.loads((ROOT / "docs" / "quick_panel.json").read_text(encoding="utf-8"))
TRUTH = "reference dt=0.05"
NEW_SEEDS = (900, 901, 902)


@pytest.fixture
def tables(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import panel_tables

    yield panel_tables
    sys.modules.pop("panel_tables")


def test_the_tables_are_those_of_the_saved_run(tables):
    text = (ROOT / "docs" / "explanation" / "quick_panel.md").read_text(encoding="utf-8")
    assert "\n".join(tables.tables(SUMMARY)) in text


def test_the_summary_is_of_the_published_run(tables):
    panel = tables.read_run(ROOT / "docs" / "quick_panel_run.json.gz")
    assert json.loads(json.dumps(tables.summary_of(panel))) == SUMMARY


def test_the_saved_run_is_of_the_panel_that_is_built_in():
    spec = read_spec("quick")
    assert {row["row"]: row["seeds"] for row in SUMMARY["rows"]} == {
        home.name: len(spec.seeds_of(home)) for home in spec.train
    }
    assert [(one["row"], one["cell"]) for one in SUMMARY["verdicts"]] == list(spec.family)
    assert SUMMARY["weights"]
    assert SUMMARY["instruction_sets"]


@pytest.mark.slow
def test_a_run_with_other_seeds_falls_into_the_saved_intervals(tmp_path):
    """Three seeds of each declared row; intervals are over seeds and starts on both sides."""
    quick = read_spec("quick")
    declared = {row for row, _ in quick.family}
    train = tuple(home for home in quick.train if home.name in declared)
    spec = replace(
        quick, seeds=NEW_SEEDS, train=train, grid=tuple(train), variations=(), ladder=False,
        family=(), compare=(), baselines=(), exploratory_seeds=None,
    )  # fmt: skip
    panel = run_panel(spec, tmp_path / "run", progress=False)
    for row in SUMMARY["rows"]:
        if row["row"] not in declared:
            continue
        entry = panel.entry(row["row"], TRUTH)
        assert entry is not None
        for found, name in ((entry.success, "success"), (entry.recovered, "recovered")):
            _, low, high = row["cells"][TRUTH][name]
            assert found.low <= high, (row["row"], name)
            assert found.high >= low, (row["row"], name)
