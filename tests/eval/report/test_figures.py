"""The figures of a panel, beside its page and for papers."""

from __future__ import annotations

import xml.etree.ElementTree
from collections.abc import Iterator
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from report_pages import panel_of, pixels
from small_panel import FORMATS, every_format, pictures_alone

from integ_gym.eval.report.figures import write_figures
from integ_gym.support import figures as style

FIGURES_OF = {
    "full": [
        "success_matrix", "transfer_gaps", "energy_residual", "refinement_ladder", "perturbations",
        "remedy",
    ],
    "given": [
        "success_matrix", "paired_success", "paired_return", "energy_residual", "refinement_ladder",
    ],
    "nothing learned": ["success_matrix", "energy_residual", "refinement_ladder"],
    "none": ["success_matrix", "transfer_gaps", "refinement_ladder", "perturbations"],
}  # fmt: skip
FIGURES_OF["hostile"] = FIGURES_OF["full"]


@pytest.fixture(scope="module", autouse=True)
def all_formats() -> Iterator[None]:
    with every_format():
        yield


def names_of(written: list[Path]) -> list[str]:
    """Names of figures, each of which is there in every format."""
    names = list(dict.fromkeys(path.stem for path in written))
    assert [path.name for path in written] == [
        n + suffix for n in names for suffix in style.FORMATS
    ]
    assert all(path.exists() for path in written)
    return names


@pytest.mark.slow
def test_figures_are_sharp_whole_and_always_the_same(tmp_path: Path) -> None:
    """Of an earlier panel's none is left where they are written."""
    before = dict(matplotlib.rcParams)
    for name in (*(f"transfer_gaps{suffix}" for suffix in FORMATS), "mine.png"):
        (tmp_path / name).write_bytes(b"old")
    written = write_figures(panel_of("given"), tmp_path)
    assert dict(matplotlib.rcParams) == before
    assert names_of(written) == FIGURES_OF["given"]
    assert sorted(tmp_path.iterdir()) == sorted([*written, tmp_path / "mine.png"])
    for path in written:
        content = path.read_bytes()
        if path.suffix == ".png":
            image = pixels(path)
            assert min(image.shape[:2]) > 300
            assert 0.02 < np.mean(np.any(image < 0.95, axis=-1)) < 0.8
        if path.suffix == ".svg":
            assert xml.etree.ElementTree.fromstring(content).tag.endswith("svg")
            assert b"<image" not in content
        if path.suffix == ".pdf":
            assert content.startswith(b"%PDF")
            assert b"/Type3" not in content
    again = write_figures(panel_of("given"), tmp_path / "again")
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in written]


@pytest.mark.parametrize(
    ("name", "look"),
    [
        ("nothing learned", "page"),
        ("none", "page"),
        ("hostile", "paper"),
        *(pytest.param(name, "paper", marks=pytest.mark.slow) for name in ("full", "none")),
        pytest.param("hostile", "page", marks=pytest.mark.slow),
    ],
)
def test_figures_take_whatever_a_panel_lacks(name: str, look: str, tmp_path: Path) -> None:
    with pictures_alone():
        assert names_of(write_figures(panel_of(name), tmp_path, look)) == FIGURES_OF[name]
