"""What is published of an atlas whose outcomes are planted."""

from __future__ import annotations

import csv

import pyarrow as pa
import pytest
from small_atlas import written
from small_panel import every_format

from integ_gym.eval.atlas.publishing import publish
from integ_gym.eval.atlas.running import summary_path
from integ_gym.eval.atlas.specification import read_atlas
from integ_gym.eval.atlas.summaries import Origin, Summary, write_summary


def planted(folder, at_home=2):
    """An atlas of two episodes a seed: so many succeed at home, and of RK4's one on the truth."""
    atlas = read_atlas(written(folder))
    for block in atlas.blocks():
        rows = [
            {
                "home": home.name, "seed": seed, "cell": cell.name, "episodes": 2,
                "successes": at_home if cell.name == home.name else 1, "recovered": 2,
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


def _losses(folder):
    with (folder / "losses.csv").open(encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines))


def test_the_map_is_written_with_every_loss_and_its_interval(tmp_path):
    out = tmp_path / "out"
    with every_format():
        files = publish(planted(tmp_path), tmp_path, out)
    assert sorted(file.name for file in files) == [
        "losses.csv", "phases.pdf", "phases.png", "phases.svg", "tables.md",
    ]  # fmt: skip
    assert sorted(file.name for file in out.iterdir()) == sorted(file.name for file in files)
    table = (out / "tables.md").read_text(encoding="utf-8").splitlines()
    assert table[0] == "| trained on | 1.5 | 3 |"
    assert table[2].startswith("| rk4 dt=0.05 | 0.50 (")
    losses = _losses(out)
    assert len(losses) == 4
    for row in losses:
        kept = float(row["success on the truth"])
        assert float(row["loss"]) == pytest.approx(float(row["success at home"]) - kept, abs=1e-3)
        assert float(row["loss low"]) < float(row["loss"]) < float(row["loss high"]) + 1e-9
        assert float(row["within twice the time"]) == 1.0
        assert int(row["seeds"]) == 2


def test_what_was_not_learned_has_no_loss(tmp_path):
    publish(planted(tmp_path, at_home=0), tmp_path, tmp_path / "out")
    assert {row["trained on"] for row in _losses(tmp_path / "out")} == set()
