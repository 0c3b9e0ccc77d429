"""The figures of a panel, beside its page and for papers."""

from __future__ import annotations

import xml.etree.ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from matplotlib.text import Text
from report_pages import panel_of, pixels
from small_panel import FORMATS, every_format, pictures_alone

from integ_gym.eval.report.figures import COLUMN, FIGURES, PAGE, SIZE, write_figures
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


@pytest.mark.parametrize("name", ["success_matrix", "transfer_gaps", "refinement_ladder"])
def test_papers_get_one_size_of_type_and_the_numbers_of_the_page(name: str) -> None:
    describe, (_, draw) = FIGURES[name]
    described: Any = describe(panel_of("full"))
    figure = draw(described)
    assert figure.get_size_inches()[0] in (COLUMN, PAGE)
    bare = {id(text) for axes in figure.axes if not axes.axison for text in axes.findobj(Text)}
    bare -= {id(text) for axes in figure.axes for text in axes.texts}
    found = [
        t for t in figure.findobj(Text) if t.get_text() and t.get_visible() and id(t) not in bare
    ]
    assert {text.get_size() for text in found} == {SIZE}
    shown = [text.get_text().split("\n")[0] for text in found]
    assert described.title not in " ".join(shown)
    if name == "success_matrix":
        assert "trained on" in shown
        for block in described.blocks:
            for line in block.lines:
                assert all(s is None or s.text in shown for s in line.shades.values())
    elif name == "transfer_gaps":
        assert described.along in shown
        assert {tick for _, tick in described.axis.ticks} <= set(shown)
        assert {line.number for block in described.blocks for line in block.lines} <= set(shown)
    else:
        plots = [axes for axes in figure.axes if axes.get_xlabel()]
        assert len(plots) == sum(len(own) for _, own in described.rows)
        assert {axes.get_xlabel() for axes in plots} == {"step, s"}
        assert plots[0].get_ylabel() == "success"
