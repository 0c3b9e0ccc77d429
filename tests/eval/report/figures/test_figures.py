"""The figures of a panel."""

from __future__ import annotations

import xml.etree.ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
import report_example as example
from report_pages import panel_from, panel_of, pixels
from small_panel import FORMATS, every_format, pictures_alone

from integ_gym.eval.report.figures import write_figures
from integ_gym.support import figures as style

ALL_FIGURES = [
    "success_matrix",
    "transfer_gaps",
    "energy_residual",
    "refinement_ladder",
    "perturbations",
    "remedy",
]


@pytest.fixture(scope="module", autouse=True)
def all_formats() -> Iterator[None]:
    with every_format():
        yield


def _names(written: list[Path]) -> list[str]:
    """Names of figures, each of which is there in every format."""
    names = list(dict.fromkeys(path.stem for path in written))
    files = [name + suffix for name in names for suffix in style.FORMATS]
    assert [path.name for path in written] == files
    assert all(path.exists() for path in written)
    return names


def _pixels(written: list[Path]) -> dict[str, Any]:
    return {path.stem: pixels(path) for path in written if path.suffix == ".png"}


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Figures of the full panel."""
    before = dict(matplotlib.rcParams)
    folder = tmp_path_factory.mktemp("panel") / "figures"
    written = write_figures(panel_of("full"), folder)
    assert dict(matplotlib.rcParams) == before
    assert sorted(folder.iterdir()) == sorted(written)
    return written


def test_figures_are_drawn_sharp_and_not_blank(drawn: list[Path]) -> None:
    assert _names(drawn) == ALL_FIGURES
    for image in _pixels(drawn).values():
        assert min(image.shape[:2]) > 500
        assert 0.02 < np.mean(np.any(image < 0.95, axis=-1)) < 0.8


def test_figures_show_the_data(drawn: list[Path], tmp_path: Path) -> None:
    with pictures_alone():  # all that is compared
        other = _pixels(write_figures(panel_from(example.full_panel(seed=9)), tmp_path))
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


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Figures of a panel of a policy given, where an earlier panel's and somebody's own were."""
    folder = tmp_path_factory.mktemp("given")
    for name in (*_stale(), "mine.png"):
        (folder / name).write_bytes(b"old")
    return write_figures(panel_of("given"), folder)


def _stale() -> list[str]:
    return [f"transfer_gaps{suffix}" for suffix in FORMATS]


@pytest.mark.parametrize("name", ["given", pytest.param("full", marks=pytest.mark.slow)])
def test_the_same_panel_gives_the_same_figures(
    name: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    before: list[Path] = request.getfixturevalue({"given": "given", "full": "drawn"}[name])
    again = write_figures(panel_of(name), tmp_path)
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in before]


LACKING = {
    "nothing learned": ["success_matrix", "energy_residual", "refinement_ladder"],
    "none": ["success_matrix", "transfer_gaps", "refinement_ladder", "perturbations"],
    "hostile": ALL_FIGURES,
}
"""Panels to the figures of what they have; the last has them all, under whatever names."""


@pytest.mark.parametrize("name", LACKING)
def test_figures_take_whatever_a_panel_lacks(name: str, tmp_path: Path) -> None:
    """As PNG files; those of other formats are the same figures, and drawn in `make test-slow`."""
    with pictures_alone():
        assert _names(write_figures(panel_of(name), tmp_path)) == LACKING[name]


@pytest.mark.slow
@pytest.mark.parametrize("name", LACKING)
def test_every_format_takes_whatever_a_panel_lacks(name: str, tmp_path: Path) -> None:
    assert _names(write_figures(panel_of(name), tmp_path)) == LACKING[name]


def test_figures_of_a_policy_given(given: list[Path]) -> None:
    paired = ["paired_success", "paired_return"]
    assert _names(given) == ["success_matrix", *paired, "energy_residual", "refinement_ladder"]


def test_figures_of_an_earlier_panel_do_not_stay(given: list[Path]) -> None:
    folder = given[0].parent
    assert not any((folder / name).exists() for name in _stale())
    assert (folder / "mine.png").read_bytes() == b"old"


@pytest.mark.slow
def test_figures_of_a_large_panel(tmp_path: Path) -> None:
    written = write_figures(panel_of("large"), tmp_path)
    assert len(_names(written)) == 4
