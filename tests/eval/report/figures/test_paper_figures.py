"""Figures for papers: a column wide, 8 pt, axes labelled, no titles, the page's numbers."""

from __future__ import annotations

import pytest
from report_pages import panel_of
from small_panel import every_format

from integ_gym.eval.report.figures import write_figures
from integ_gym.eval.report.forests import gap_forest
from integ_gym.eval.report.ladders import ladder_plots
from integ_gym.eval.report.matrices import success_matrix
from integ_gym.eval.report.paper import (
    COLUMN,
    PAGE,
    SIZE,
    print_forest,
    print_ladders,
    print_matrix,
)
from integ_gym.support.figures import FORMATS

DRAWN = {"matrix": (success_matrix, print_matrix), "forest": (gap_forest, print_forest),
         "ladders": (ladder_plots, print_ladders)}  # fmt: skip


def drawn(name: str):
    describe, draw = DRAWN[name]
    described = describe(panel_of("full"))
    return described, draw(described)


def texts(figure) -> list:
    found = list(figure.texts)
    for axes in figure.axes:
        found += [*axes.texts, axes.xaxis.label, axes.yaxis.label, axes.title]
        found += [*axes.get_xticklabels(), *axes.get_yticklabels()] if axes.axison else []
    return [text for text in found if text.get_text()]


@pytest.mark.parametrize("name", DRAWN)
def test_type_is_of_one_size_and_the_width_is_a_paper_s(name):
    described, figure = drawn(name)
    assert {text.get_size() for text in texts(figure)} == {SIZE}
    assert figure.get_size_inches()[0] in (COLUMN, PAGE)
    said = " ".join(text.get_text() for text in texts(figure))
    assert getattr(described, "title", "Refinement ladder") not in said


def test_a_matrix_has_the_numbers_of_the_page():
    matrix, figure = drawn("matrix")
    said = [text.get_text().split("\n")[0] for text in texts(figure)]
    for block in matrix.blocks:
        for line in block.lines:
            for _, shades in line.shades:
                for _, shade in shades:
                    assert shade is None or shade.text in said
    assert any(text.startswith("judged on") for text in said)
    assert "trained on" in said


def test_a_forest_has_the_ticks_and_numbers_of_the_page():
    forest, figure = drawn("forest")
    said = [text.get_text() for text in texts(figure)]
    assert "loss of success by overfitting" in said
    for _, tick in forest.axis.ticks:
        assert tick in said
    for block in forest.blocks:
        for line in block.lines:
            assert line.number in said


def test_ladders_label_their_axes():
    ladders, figure = drawn("ladders")
    plots = [axes for axes in figure.axes if axes.get_xlabel()]
    assert len(plots) == sum(len(own) for _, own in ladders.rows)
    assert {axes.get_xlabel() for axes in plots} == {"step, s"}
    assert plots[0].get_ylabel() == "success"


@pytest.mark.slow
def test_all_figures_are_written_in_all_formats(tmp_path):
    with every_format():
        page = write_figures(panel_of("full"), tmp_path / "page")
        paper = write_figures(panel_of("full"), tmp_path / "paper", "paper")
    assert [path.name for path in page] == [path.name for path in paper]
    assert {path.suffix for path in paper} == set(FORMATS)
