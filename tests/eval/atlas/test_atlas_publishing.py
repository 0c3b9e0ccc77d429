"""What is published of an atlas whose outcomes are planted."""

from __future__ import annotations

import csv
from dataclasses import replace

import pyarrow as pa
import pytest
from small_atlas import written

from integ_gym.eval import publish, read_atlas
from integ_gym.eval.atlas.numbers import CANDIDATES, GUESSES
from integ_gym.eval.atlas.prediction import law
from integ_gym.eval.atlas.running import summary_path
from integ_gym.eval.atlas.summaries import Origin, Summary, write_summary


def planted(folder, held_out):
    """An atlas whose policies succeed at home, and of RK4's half on the truth."""
    atlas = read_atlas(written(folder, held_out=f"held_out = {held_out}"))
    for block in atlas.blocks():
        rows = [
            {
                "home": home.name, "seed": seed, "cell": cell.name, "episodes": 2,
                "successes": 2 if cell.name == home.name else 1, "recovered": 2,
            }
            for home in block.panel.train
            for seed in block.panel.seeds
            for cell in block.panel.columns()
        ]  # fmt: skip
        origin = Origin(
            atlas=atlas.name, ratio=block.ratio, limit=block.limit, seal=block.name, weights="",
            code="one", versions={}, specification=block.panel.to_json(), cost={},
        )  # fmt: skip
        write_summary(Summary(origin, pa.Table.from_pylist(rows)), summary_path(folder, block))
    return atlas


def test_a_law_is_fitted_to_what_may_be_seen(tmp_path):
    atlas = planted(tmp_path, [3.0])
    found = publish(atlas, tmp_path, tmp_path / "out")
    assert found.law.atlas == "small"
    assert found.law.margins == (1.5, 1.5)
    assert {curve.number for curve in found.law.curves} == {*CANDIDATES, *GUESSES}
    assert found.law.curve.number in CANDIDATES
    assert [one.number for one in found.trials] == [curve.number for curve in found.law.curves]
    assert all(one.points == 2 for one in found.trials)
    assert (tmp_path / "out" / "law.json").exists()


def test_a_law_is_made_of_the_number_that_is_stated(tmp_path):
    stated = "critical ratio"
    atlas = replace(planted(tmp_path, [3.0]), number=stated)
    found = publish(atlas, tmp_path, tmp_path / "out")
    assert found.law.curve.number == found.trials[0].number == stated
    assert {curve.number for curve in found.law.curves} == {*CANDIDATES, *GUESSES}


def test_where_all_is_held_out_the_package_s_law_is_held_against_it(tmp_path):
    atlas = planted(tmp_path, [1.5, 3.0])
    found = publish(atlas, tmp_path, tmp_path / "out")
    assert found.law == law()
    assert found.trials[0].number == law().curve.number
    assert all(one.points == 4 for one in found.trials)

    assert found.trials[0].error == pytest.approx(0.25, abs=0.02)
    assert not (tmp_path / "out" / "law.json").exists()
    tables = (tmp_path / "out" / "tables.md").read_text(encoding="utf-8")
    by_number, by_limit = tables.split("| error at | 1.5 | 3 |")
    assert by_number.count("| force of the numerics |") == 1
    assert by_limit.count("| force of the numerics |") == 1
    assert "| *losses* | 2 | 2 |" in by_limit
    with (tmp_path / "out" / "losses.csv").open(encoding="utf-8", newline="") as lines:
        losses = list(csv.DictReader(lines))
    assert len(losses) == 4
    for row in losses:
        kept = float(row["success on the truth"]) / float(row["success at home"])
        assert float(row["loss"]) == pytest.approx(1.0 - kept, abs=1e-3)
        assert 0.0 < float(row["off by chance"]) < 1.0
        assert float(row["within twice the time"]) == 1.0
        assert row["held out"] == "True"
