"""The figures of a panel."""

from __future__ import annotations

import xml.etree.ElementTree
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
import report_example as example
from report_pages import panel_from, panel_of, pixels

from integ_gym.eval.report import figures
from integ_gym.support.figures import style
from integ_gym.support.figures.style import FORMATS

ALL_FIGURES = [
    "success_matrix",
    "transfer_gaps",
    "energy_residual",
    "refinement_ladder",
    "perturbations",
    "remedy",
]


def _names(written: list[Path]) -> list[str]:
    """Names of figures, each of which is there in every format."""
    names = list(dict.fromkeys(path.stem for path in written))
    assert [path.name for path in written] == [n + suffix for n in names for suffix in FORMATS]
    assert all(path.exists() for path in written)
    return names


def _pixels(written: list[Path]) -> dict[str, Any]:
    return {path.stem: pixels(path) for path in written if path.suffix == ".png"}


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Figures of the full panel."""
    before = dict(matplotlib.rcParams)
    folder = tmp_path_factory.mktemp("panel") / "figures"
    written = figures.write_figures(panel_of("full"), folder)
    assert dict(matplotlib.rcParams) == before
    assert sorted(folder.iterdir()) == sorted(written)
    return written


def test_figures_are_drawn_sharp_and_not_blank(drawn: list[Path]) -> None:
    assert _names(drawn) == ALL_FIGURES
    for image in _pixels(drawn).values():
        assert min(image.shape[:2]) > 500
        assert 0.02 < np.mean(np.any(image < 0.95, axis=-1)) < 0.8


def test_figures_show_the_data(
    drawn: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(style, "FORMATS", {".png": FORMATS[".png"]})  # all that is compared
    other = _pixels(figures.write_figures(panel_from(example.full_panel(seed=9)), tmp_path))
    for name, a in _pixels(drawn).items():
        b = other[name]
        assert a.shape != b.shape or np.any(a != b, axis=-1).mean() > 0.001


def test_papers_get_whole_vector_figures(drawn: list[Path]) -> None:
    for path in drawn:
        content = path.read_bytes()
        if path.suffix == ".svg":
            assert xml.etree.ElementTree.fromstring(content).tag.endswith("svg")
            assert b"<image" not in content
        if path.suffix == ".pdf":
            assert content.startswith(b"%PDF")
            assert b"/Type3" not in content


def test_the_same_panel_gives_the_same_figures(drawn: list[Path], tmp_path: Path) -> None:
    again = figures.write_figures(panel_of("full"), tmp_path)
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in drawn]


@pytest.mark.parametrize("name", ["given", "nothing learned", "none", "hostile"])
def test_figures_take_whatever_a_panel_lacks(name: str, tmp_path: Path) -> None:
    written = figures.write_figures(panel_of(name), tmp_path)
    expected = {
        "given": ["success_matrix", "energy_residual", "refinement_ladder"],
        "nothing learned": ["success_matrix", "energy_residual", "refinement_ladder"],
        "none": [
            "success_matrix",
            "transfer_gaps",
            "refinement_ladder",
            "perturbations",
        ],
        "hostile": ALL_FIGURES,
    }
    assert _names(written) == expected[name]


def test_figures_of_an_earlier_panel_do_not_stay(tmp_path: Path) -> None:
    stale = [tmp_path / f"transfer_gaps{suffix}" for suffix in FORMATS]
    for path in stale:
        path.write_bytes(b"old")
    (tmp_path / "mine.png").write_bytes(b"mine")
    figures.write_figures(panel_of("given"), tmp_path)
    assert not any(path.exists() for path in stale)
    assert (tmp_path / "mine.png").exists()


@pytest.mark.slow
def test_figures_of_a_large_panel(tmp_path: Path) -> None:
    written = figures.write_figures(panel_of("large"), tmp_path)
    assert len(_names(written)) == 4
