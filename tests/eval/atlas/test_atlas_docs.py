"""The atlas in the repository: what its page says is what its summaries give."""

from __future__ import annotations

from pathlib import Path

import pytest
from house import ROOT
from small_panel import every_format

from integ_gym.eval.atlas.publishing import publish
from integ_gym.eval.atlas.running import finished
from integ_gym.eval.atlas.specification import read_atlas

SUMMARIES = sorted(path.parent for path in (ROOT / "docs" / "atlas").glob("*/figures"))
FIGURES = {f"phases.{kind}" for kind in ("png", "svg", "pdf")}


@pytest.mark.parametrize("folder", SUMMARIES, ids=lambda folder: folder.name)
def test_every_summary_is_of_its_specification(folder: Path):
    atlas = read_atlas(ROOT / "specs" / "atlas" / f"{folder.name}.toml")
    there = {f"{block.name}.parquet" for block, _ in finished(atlas, folder)}
    assert there == {file.name for file in folder.glob("*.parquet")}


@pytest.mark.slow
@pytest.mark.parametrize("folder", SUMMARIES, ids=lambda folder: folder.name)
def test_figures_and_tables_come_from_the_summaries(folder: Path, tmp_path):
    atlas = read_atlas(ROOT / "specs" / "atlas" / f"{folder.name}.toml")
    with every_format():
        publish(atlas, folder, tmp_path)
    written = {file.name for file in tmp_path.iterdir()}
    assert written == {file.name for file in (folder / "figures").iterdir()}
    assert written == {"tables.md", "losses.csv", *FIGURES}
    for name in written - FIGURES:
        assert (tmp_path / name).read_bytes() == (folder / "figures" / name).read_bytes()
    for name in FIGURES:
        assert (tmp_path / name).stat().st_size > 10_000
