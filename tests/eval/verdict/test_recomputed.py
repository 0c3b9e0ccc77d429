"""Code that was written from the documentation alone comes to the same p-values and shares."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

from integ_gym.eval.verdict import Looks, Rates, p_overfitting_exceeds, p_overfitting_within

SCRIPT = Path(__file__).parents[3] / "benchmarks" / "recomputed.py"
_spec = importlib.util.spec_from_file_location("recomputed", SCRIPT)
assert _spec is not None
assert _spec.loader is not None
recomputed = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(recomputed)

DRAWS = 20_000


@pytest.mark.parametrize("handmade", [None, np.ones(50)])
@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_p_values_follow_from_the_documentation(loss, handmade):
    rng = np.random.default_rng(3)
    home, native = (rng.binomial(20, 0.97, 40) / 20 for _ in range(2))
    there = rng.binomial(20, 0.97 - loss, 40) / 20
    rates = Rates(home, there, there, native, handmade)
    yardsticks = [native] if handmade is None else [native, handmade]
    row = np.stack([home, there], axis=1)
    for margin, weight in ((0.2, 0.6), (-0.1, 1.0)):
        theirs = recomputed.p_exceeds(rng, row, yardsticks, margin, weight, DRAWS)
        ours = p_overfitting_exceeds(rates, margin, weight, draws=DRAWS)
        assert theirs == pytest.approx(ours, abs=0.01)
    theirs = recomputed.p_within(rng, row, yardsticks, 0.1, DRAWS)
    assert theirs == pytest.approx(p_overfitting_within(rates, 0.1, draws=DRAWS), abs=0.01)


def test_shares_follow_from_the_documentation():
    looks = (4, 10, 33, 42, 52, 64)
    for now, seeds in enumerate(looks):
        ours = Looks(looks[:now]).shares(seeds)
        assert recomputed.share_at(looks, now, 5) == ours.exceeds
        assert recomputed.share_at(looks, now, 33) == ours.equivalent
        ours = Looks(looks[:now], looks[1:]).shares(seeds)
        planned = [recomputed.share_planned(looks, now, least) for least in (5, 30)]
        assert planned == pytest.approx([ours.exceeds, ours.equivalent])


def test_the_script_imports_nothing_of_the_package():
    assert "integ_gym" not in SCRIPT.read_text(encoding="utf-8")


def test_verdicts_of_a_run_follow_from_its_records(panel_directory, capsys):
    recomputed.verdicts(panel_directory)
    lines = capsys.readouterr().out.splitlines()
    told = json.loads((panel_directory / "panel.json").read_text(encoding="utf-8"))["verdicts"]
    assert told
    for one in told:
        place = next(i for i, x in enumerate(lines) if f"{one['row']} → {one['cell']}:" in x)
        verdict = lines[place].split(": ")[1].split(",")[0]
        assert verdict == lines[place + 1].split(": ")[1].split(",")[0] == one["verdict"]


def test_failures_where_nobody_can_win_say_nothing_of_loops(tmp_path, monkeypatch, capsys):
    cells = {"rk4": "achievable", "reference": "achievable", "closed": "unachievable"}
    success = {"rk4": [1.0, 0.0], "reference": [0.0, 1.0], "closed": [0.0, 0.0]}
    panel = {
        "rows": [{"name": "row", "kind": "trained", "learned": True}],
        "cells": [{"name": x, "kind": "grid", "achievability": can} for x, can in cells.items()],
        "matrix": [{"row": "row", "cell": x, "success_by_seed": y} for x, y in success.items()],
    }
    (tmp_path / "panel.json").write_text(json.dumps(panel), encoding="utf-8")
    monkeypatch.setattr(recomputed, "radii", lambda *_: np.array([0.9, 0.5]))
    recomputed.loops(tmp_path)
    told = capsys.readouterr().out
    assert "all cells: 6 loops, 6 stable, of which 4 fail" in told
    assert "cells that can be won: 4 loops, 4 stable, of which 2 fail; area 0.50" in told
