"""The figures of a panel."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
import pytest
import report_example as example
from report_pages import panel_from, panel_of, pixels

from integ_gym.eval import figures

ALL_FIGURES = [
    "success_matrix.png",
    "transfer_gaps.png",
    "energy_residual.png",
    "refinement_ladder.png",
    "perturbations.png",
    "remedy.png",
]


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Figures of the full panel."""
    before = dict(matplotlib.rcParams)
    folder = tmp_path_factory.mktemp("panel") / "figures"
    written = figures.write_figures(panel_of("full"), folder)
    assert dict(matplotlib.rcParams) == before
    assert sorted(entry.name for entry in folder.iterdir()) == sorted(ALL_FIGURES)
    return written


def test_figures_are_drawn_sharp_and_not_blank(drawn: list[Path]) -> None:
    assert [path.name for path in drawn] == ALL_FIGURES
    for path in drawn:
        image = pixels(path)
        assert min(image.shape[:2]) > 700
        assert 0.02 < np.mean(np.any(image < 0.95, axis=-1)) < 0.8


def test_figures_show_the_data(drawn: list[Path], tmp_path: Path) -> None:
    other = figures.write_figures(panel_from(example.full_panel(seed=9)), tmp_path)
    for first, second in zip(drawn, other, strict=True):
        a, b = pixels(first), pixels(second)
        assert a.shape != b.shape or np.any(a != b, axis=-1).mean() > 0.001


def test_the_same_panel_gives_the_same_figures(drawn: list[Path], tmp_path: Path) -> None:
    again = figures.write_figures(panel_of("full"), tmp_path)
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in drawn]


@pytest.mark.parametrize("name", ["given", "nothing learned", "none", "hostile"])
def test_figures_take_whatever_a_panel_lacks(name: str, tmp_path: Path) -> None:
    written = figures.write_figures(panel_of(name), tmp_path)
    expected = {
        "given": ["success_matrix.png", "energy_residual.png", "refinement_ladder.png"],
        "nothing learned": ["success_matrix.png", "energy_residual.png", "refinement_ladder.png"],
        "none": [
            "success_matrix.png",
            "transfer_gaps.png",
            "refinement_ladder.png",
            "perturbations.png",
        ],
        "hostile": ALL_FIGURES,
    }
    assert [path.name for path in written] == expected[name]


def test_figures_of_an_earlier_panel_do_not_stay(tmp_path: Path) -> None:
    stale = tmp_path / "transfer_gaps.png"
    stale.write_bytes(b"old")
    (tmp_path / "mine.png").write_bytes(b"mine")
    figures.write_figures(panel_of("given"), tmp_path)
    assert not stale.exists()
    assert (tmp_path / "mine.png").exists()


def test_figures_of_a_large_panel(tmp_path: Path) -> None:
    written = figures.write_figures(panel_of("large"), tmp_path)
    assert len(written) == 4
