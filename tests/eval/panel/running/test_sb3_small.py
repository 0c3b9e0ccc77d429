"""The small panel of stable-baselines3, reduced: the same rows and cells, fewer decisions."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

import integ_gym
from integ_gym.eval.panel.spec import read_spec

SPEC = Path(__file__).parents[4] / "specs" / "sb3_small.toml"


@pytest.mark.slow
def test_the_small_panel_reduced(tmp_path):
    whole = read_spec(SPEC)
    assert (whole.trainer, len(whole.train), len(whole.seeds)) == ("sb3", 2, 5)
    training = {**whole.training, "total_steps": 8192}
    spec = replace(whole, seeds=whole.seeds[:2], episodes=3, training=training)
    panel = integ_gym.run_panel(spec, tmp_path / "run", progress=False)
    assert (tmp_path / "run" / "report.html").exists()
    assert len(list((tmp_path / "run" / "policies").glob("*/policy.zip"))) == 4
    (verdict,) = json.loads((tmp_path / "run" / "panel.json").read_text())["verdicts"]
    assert verdict["verdict"] == "not_learned"
    assert [row.name for row in panel.rows if row.kind == "trained"] == [
        "symplectic_euler dt=0.05",
        "reference dt=0.05",
    ]
