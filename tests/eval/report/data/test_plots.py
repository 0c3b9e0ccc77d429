"""What the page and the figures both draw: one description of each plot, one style for a name."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest
from house import ROOT
from matplotlib.patches import Rectangle
from matplotlib.text import Text
from report_pages import every_panel, page_of, panel_of
from report_rows import IMPOSSIBLE, SLOW

from integ_gym.envs.registries import ENGINES, INTEGRATORS
from integ_gym.eval.panel.result import Estimate
from integ_gym.eval.report.figures import FIGURES
from integ_gym.eval.report.forests import (
    check_forest,
    gap_forest,
    paired_return,
    paired_success,
    remedy_forest,
)
from integ_gym.eval.report.ladders import ladder_plots
from integ_gym.eval.report.matrices import energy_matrix, success_matrix, value_axis
from integ_gym.eval.report.page import render
from integ_gym.eval.scheme_style import NATIVE, styles_of
from integ_gym.support.figures import HUES, MARKERS, PALETTE, channels

VISION = {
    "common": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}
"""What is seen of linear red, green and blue (Machado, Oliveira and Fernandes 2009, severity 1)."""

XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def _linear(colour: str) -> np.ndarray:
    share = np.array(channels(colour)) / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def _lab(linear: np.ndarray) -> np.ndarray:
    """CIE L*a*b* of linear red, green and blue."""
    ratio = XYZ @ np.clip(linear, 0.0, 1.0) / XYZ.sum(axis=1)
    root = np.where(ratio > 0.008856, np.cbrt(ratio), 7.787 * ratio + 16.0 / 116.0)
    x, y, z = root
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


def _contrast(one: str, other: str) -> float:
    low, high = sorted(float(XYZ[1] @ _linear(colour)) + 0.05 for colour in (one, other))
    return high / low


@pytest.mark.parametrize("ground", [0, 1], ids=["light", "dark"])
@pytest.mark.parametrize("eyes", VISION)
def test_hues_stay_apart_for_colour_blind_readers(ground: int, eyes: str) -> None:
    seen = {name: _lab(VISION[eyes] @ _linear(pair[ground])) for name, pair in HUES.items()}
    for one, other in itertools.combinations(seen, 2):
        assert np.linalg.norm(seen[one] - seen[other]) > 15.0, (one, other)


@pytest.mark.parametrize("ground", [0, 1], ids=["light", "dark"])
def test_hues_stand_out_from_the_ground(ground: int) -> None:
    for name, pair in HUES.items():
        assert _contrast(pair[ground], PALETTE["card"][ground]) >= 2.9, name


def test_our_integrators_have_one_style_each_wherever_they_are_shown() -> None:
    assert set(INTEGRATORS.names()) == set(NATIVE)
    styles = styles_of(INTEGRATORS.names())
    assert len({style.hue for style in styles.values()}) == len(styles)
    assert len({style.marker for style in styles.values()}) == len(styles)
    for name in INTEGRATORS.names():
        assert styles_of([name]) == {name: styles[name]}
        assert styles_of(["my_module:Heun", name, "drake radau1"])[name] == styles[name]


def test_other_names_have_a_style_of_their_own_that_stays() -> None:
    names = [f"{engine} {name}" for engine in ENGINES.names() for name in ("euler", "rk4", "own")]
    names += ["my_module:Heun", "planted:Silent"]
    styles = styles_of(names)
    assert len(set(styles.values())) == len(names)
    assert not set(styles.values()) & set(NATIVE.values())
    assert styles_of(reversed(names)) == styles
    assert list(styles_of(["b", "a"])) == ["b", "a"]
    alone = [styles_of([name])[name] == styles[name] for name in names]
    assert np.mean(alone) > 0.5
    assert styles_of(["my_module:Heun"])["my_module:Heun"].marker in MARKERS


def _drawn(name: str, panel: str = "full") -> str:
    """All text of a figure."""
    describe, draw = FIGURES[name]
    figure = draw(describe(panel_of(panel)))
    return " ".join(text.get_text().replace("\n", "") for text in figure.findobj(Text))


@pytest.mark.parametrize(
    ("name", "panel", "describe"),
    [
        ("transfer_gaps", "full", gap_forest),
        ("perturbations", "full", check_forest),
        ("remedy", "full", remedy_forest),
        ("paired_success", "given", paired_success),
        ("paired_return", "given", paired_return),
    ],
)
def test_forests_are_the_same_on_the_page_and_in_the_figure(name, panel, describe) -> None:
    forest, text, page = describe(panel_of(panel)), _drawn(name, panel), page_of(panel)
    shown = " ".join(page.text.split())
    for _, label in forest.axis.ticks:
        assert label in text
        assert label in shown
    for block in forest.blocks:
        for line in block.lines:
            assert f"{line.number} {line.detail}" in shown
            assert panel_of(panel).said(line.words) in page.values("aria-label")
            for part in (line.number, line.detail, line.cell):
                assert part in text


def test_a_given_policy_is_held_against_itself_cell_by_cell() -> None:
    """A mark is filled where the adjusted p-value is below 0.05; the truth is named so."""
    panel = panel_of("given")
    success, earned = paired_success(panel), paired_return(panel)
    assert [line.cell for line in success.blocks[0].lines] == [
        panel.called(one.cell) for one in panel.paired
    ]
    filled = {line.cell for line in success.blocks[0].lines if line.marks[0].filled}
    assert filled == {one.cell for one in panel.paired if one.p_success_adjusted < 0.05}
    assert 0 < len(filled) < len(panel.paired)
    assert not any(line.marks[0].filled for line in earned.blocks[0].lines)
    assert len(earned.blocks[0].lines) == sum(one.returns is not None for one in panel.paired)
    text = " ".join(page_of("given").text.split())
    assert "my_policy.zip, 40 starts: discretizations against what it does on the truth" in text
    assert paired_success(panel_of("full")) is None
    assert "paired" not in page_of("full").values("id")


@pytest.mark.parametrize(
    ("ends", "ticks"),
    [
        ((0.0, 799.0), ["\u2212200", "0", "200", "400", "600", "800"]),
        ((-0.03, 0.011), ["\u22120.03", "\u22120.02", "\u22120.01", "0.00", "0.01", "0.02"]),
        ((0.0, 0.0), ["\u22121", "0", "1"]),
        ((-12.0, -3.0), ["\u221215", "\u221210", "\u22125", "0", "5"]),
    ],
)
def test_an_axis_of_values_holds_them_and_zero(ends, ticks) -> None:
    axis = value_axis(Estimate(end) for end in ends)
    assert [text for _, text in axis.ticks] == ticks
    assert axis.low < 0.0 < axis.high
    assert axis.low <= min(ends) <= max(ends) <= axis.high


@pytest.mark.parametrize(
    ("name", "describe", "measure"),
    [("success_matrix", success_matrix, "success"), ("energy_residual", energy_matrix, "energy")],
)
def test_matrices_are_the_same_on_the_page_and_in_the_figure(name, describe, measure) -> None:
    panel, page = panel_of("full"), page_of("full")
    matrix, text = describe(panel), _drawn(name)
    (told,) = [one for one in page.carried[0]["measures"] if one["name"] == measure]
    shades = [
        (panel.anchor(line.row.name, cell.name), shade)
        for block in matrix.blocks
        for line in block.lines
        for _, cells in line.shades
        for cell, shade in cells
        if shade is not None
    ]
    assert len(shades) > 100
    for anchor, shade in shades:
        assert told["cells"][anchor][0] == shade.text
        assert told["cells"][anchor][3] == panel.said(shade.words)
        assert shade.text in text
    assert told["ends"] == list(matrix.ends)
    for words in (*matrix.notes, *matrix.ends, *(words for _, words in matrix.hatchings)):
        assert words in text


def test_the_matrix_reads_without_a_script() -> None:
    panel, page = panel_of("full"), page_of("full")
    matrix, text = success_matrix(panel), " ".join(page.text.split())
    shown = [s for b in matrix.blocks for x in b.lines for _, cells in x.shades for _, s in cells]
    for shade in shown:
        assert panel.said(shade.words) in page.values("aria-label")
    for words in (*matrix.notes, *matrix.ends, *(words for _, words in matrix.hatchings)):
        assert words in text


def test_cells_that_cannot_be_solved_in_time_are_hatched_on_the_page_and_in_the_figure() -> None:
    panel, page = panel_of("full"), page_of("full")
    matrix = success_matrix(panel)
    hatched = [
        (cell, shade)
        for block in matrix.blocks
        for line in block.lines
        for _, cells in line.shades
        for cell, shade in cells
        if shade.hatched
    ]
    rows, statuses = len(panel.rows), {"too_slow", "unachievable"}
    assert {cell.name for cell, _ in hatched} == {IMPOSSIBLE, SLOW}
    assert [name for name, _ in matrix.hatchings] == ["too_slow", "unachievable"]
    for cell, shade in hatched:
        assert shade.hatched == cell.achievability
        assert shade.words.endswith(
            f"the cell is {shade.hatched.replace('_', ' ')}: {cell.achievability_reason}"
        )
        assert panel.said(shade.words) in page.values("title")
    classes = [set(own.get("class", "").split()) for tag, own in page.tags if tag == "a"]
    _, draw = FIGURES["success_matrix"]
    patches = [patch.get_hatch() for patch in draw(matrix).findobj(Rectangle)]
    hatches = {patch for patch in patches if patch}
    assert len(hatches) == len(statuses)
    for status in statuses:
        assert classes.count({"rate", "hatched", status}) >= rows - 1
        assert sum(status in own for own in classes) == rows
    assert sorted(patches.count(hatch) for hatch in hatches) == [rows + 1, rows + 1]
    for other in (energy_matrix(panel), success_matrix(panel_of("given"))):
        assert other.hatchings == ()


def test_ladders_are_the_same_on_the_page_and_in_the_figure() -> None:
    ladders = ladder_plots(panel_of("full"))
    text, html = _drawn("refinement_ladder"), render(panel_of("full"))
    page = page_of("full")
    hues = {}
    for name, style in ladders.schemes.items():
        assert name in text
        key = html[: html.index(f"</svg>{name.replace('_', '_<wbr>')}</span>")].rsplit("<svg", 1)[1]
        hues[name] = re.findall(r"h-(\w+)", key)
        assert set(hues[name]) == {style.hue}
    for row, plots in ladders.rows:
        assert row in text
        for plot in plots:
            assert plot.about in text
            assert f"Success of {row} against the step, {plot.about}" in page.values("aria-label")
            for _, label in plot.ticks:
                assert label in text
            for series in plot.series:
                assert all(point.words in page.text for point in series.points)


@every_panel
def test_colours_are_written_once(name: str) -> None:
    """A page has the colours of the palette, and figures have no others by hand."""
    html = render(panel_of(name))
    for colour, (light, dark) in PALETTE.items():
        if colour not in ("warm", "cool"):
            assert html.count(f"--{colour}: {light};") == html.count(f"--{colour}: {dark};") == 1
    own = ROOT / "eval" / "report"
    sources = [path for kind in ("py", "css", "js") for path in own.rglob(f"*.{kind}")]
    sources.append(ROOT / "support" / "page.css")
    assert len(sources) > 15
    for source in sources:
        found = re.findall(r"#[0-9a-fA-F]{6}\b", source.read_text(encoding="utf-8"))
        assert not found, source


def test_integrators_keep_their_colour_when_others_leave() -> None:
    styles = ladder_plots(panel_of("full")).schemes
    for other in ("given", "large", "nothing learned"):
        shown = ladder_plots(panel_of(other)).schemes
        assert set(shown) & set(styles)
        for name in set(shown) & set(styles):
            assert shown[name] == styles[name]
