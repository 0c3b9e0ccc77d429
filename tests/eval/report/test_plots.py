"""What page and figures both draw: read out of the panel once, in one style for each name."""

from __future__ import annotations

import copy
import itertools

import numpy as np
import pytest
from matplotlib.patches import Rectangle
from matplotlib.text import Text
from report_example import IMPOSSIBLE, PERIOD, SCHEMES, SLOW, STEPS, UNKNOWN
from report_pages import page_of, panel_from, panel_of, raw_of, render

from integ_gym.envs.registries import ENGINES, INTEGRATORS
from integ_gym.eval.panel.conclusions import solvable_reason
from integ_gym.eval.report.figures import FIGURES
from integ_gym.eval.report.findings import findings_of
from integ_gym.eval.report.forests import (
    check_forest,
    checks_of,
    gap_forest,
    paired_return,
    paired_success,
    remedy_forest,
    trust_of,
)
from integ_gym.eval.report.ladders import ladders_of, sweep_plots
from integ_gym.eval.report.matrices import energy_matrix, success_matrix
from integ_gym.eval.scheme_style import NATIVE, styles_of
from integ_gym.support.figures import HUES, MARKERS, PALETTE, channels

VISION = {
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
}
"""What is seen of linear red, green and blue (Machado, Oliveira and Fernandes 2009, severity 1)."""

XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def linear(colour: str) -> np.ndarray:
    share = np.array(channels(colour)) / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def lab(seen: np.ndarray) -> np.ndarray:
    """CIE L*a*b* of linear red, green and blue."""
    ratio = XYZ @ np.clip(seen, 0.0, 1.0) / XYZ.sum(axis=1)
    x, y, z = np.where(ratio > 0.008856, np.cbrt(ratio), 7.787 * ratio + 16.0 / 116.0)
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


@pytest.mark.parametrize("ground", [0, 1], ids=["light", "dark"])
def test_hues_stay_apart_for_colour_blind_readers_and_stand_out(ground):
    for eyes in VISION.values():
        seen = {name: lab(eyes @ linear(pair[ground])) for name, pair in HUES.items()}
        for one, other in itertools.combinations(seen, 2):
            assert np.linalg.norm(seen[one] - seen[other]) > 15.0, (one, other)
    for name, pair in HUES.items():
        colours = pair[ground], PALETTE["card"][ground]
        low, high = sorted(float(XYZ[1] @ linear(colour)) + 0.05 for colour in colours)
        assert high / low >= 2.9, name


def test_every_name_has_a_style_of_its_own_that_stays():
    """A new integrator has one of those that its name gives, like that of an engine or a user."""
    ours = list(NATIVE)
    assert set(ours) <= set(INTEGRATORS.names())
    styles = styles_of(ours)
    assert len({style.hue for style in styles.values()}) == len(styles)
    assert len({style.marker for style in styles.values()}) == len(styles)
    for name in ours:
        assert styles_of(["my_module:Heun", name, "drake radau1"])[name] == styles[name]
    names = [f"{engine} {name}" for engine in ENGINES.names() for name in ("euler", "rk4", "own")]
    names += ["my_module:Heun", "planted:Silent"]
    others = styles_of(names)
    assert len(set(others.values())) == len(names)
    assert not set(others.values()) & set(NATIVE.values())
    assert styles_of(reversed(names)) == others
    assert {style.marker for style in others.values()} <= set(MARKERS)


def drawn(name: str, panel: str = "full") -> str:
    """All text of a figure."""
    describe, (draw, _) = FIGURES[name]
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
def test_forests_are_the_same_on_the_page_and_in_the_figure(name, panel, describe):
    forest, text, page = describe(panel_of(panel)), drawn(name, panel), page_of(panel)
    shown = " ".join(page.text.split())
    for _, label in forest.axis.ticks:
        assert label in text
        assert label in shown
    for block in forest.blocks:
        for line in block.lines:
            assert f"{line.number} {line.detail}" in shown
            assert line.words in page.values("aria-label")
            for part in (line.number, line.detail, line.cell):
                assert part in text


def shades_of(matrix):
    return [
        (line.row, cell, shade)
        for block in matrix.blocks
        for line in block.lines
        for cell, shade in line.shades.items()
        if shade is not None
    ]


@pytest.mark.parametrize(
    ("name", "describe", "measure"),
    [("success_matrix", success_matrix, "success"), ("energy_residual", energy_matrix, "energy")],
)
def test_matrices_are_the_same_on_the_page_and_in_the_figure(name, describe, measure):
    panel, page = panel_of("full"), page_of("full")
    matrix, text = describe(panel), drawn(name)
    (carried,) = [one for one in page.carried[0]["measures"] if one["name"] == measure]
    shades = shades_of(matrix)
    assert len(shades) > 100
    for row, cell, shade in shades:
        entry = carried["cells"][panel.anchor(row.name, cell)]
        assert (entry[0], entry[3]) == (shade.text, shade.words)
        assert shade.text in text
        if measure == "success":  # reads without a script
            assert entry[3] in page.values("aria-label")
    assert carried["ends"] == list(matrix.ends)
    shown = " ".join(page.text.split())
    for words in (*matrix.notes, *matrix.ends, *(words for _, words in matrix.hatchings)):
        assert words in text
        assert measure != "success" or words in shown


def test_cells_that_cannot_be_solved_in_time_are_hatched_on_the_page_and_in_the_figure():
    panel, page = panel_of("full"), page_of("full")
    matrix = success_matrix(panel)
    hatched = [(cell, shade) for _, cell, shade in shades_of(matrix) if shade.hatched]
    rows, statuses = len(panel.rows), {"too_slow", "unachievable"}
    assert {cell for cell, _ in hatched} == {IMPOSSIBLE, SLOW}
    assert {name for name, _ in matrix.hatchings} == statuses
    for cell, shade in hatched:
        assert shade.hatched == panel.cell(cell).achievability
        assert solvable_reason(panel, panel.cell(cell)) in shade.words
    classes = [set(own.get("class", "").split()) for tag, own in page.tags if tag == "a"]
    _, (draw, _) = FIGURES["success_matrix"]
    patches = [patch.get_hatch() for patch in draw(matrix).findobj(Rectangle)]
    hatches = set(filter(None, patches))
    assert len(hatches) == len(statuses)
    assert all(sum(status in own for own in classes) == rows for status in statuses)
    assert all(patches.count(hatch) == rows + 1 for hatch in hatches)
    for other in (energy_matrix(panel), success_matrix(panel_of("given"))):
        assert other.hatchings == ()


def test_findings_say_what_the_truth_contradicts():
    panel = panel_of("full")
    found = findings_of(panel, trust_of(panel))
    assert [one.kind for one in found if one.kind not in ("false_pass", "false_fail")] == [
        *["fails"] * sum(judged.verdict == "fails" for judged in panel.verdicts), "agreement"
    ]  # fmt: skip
    classes = [entry.reference_class for entry in panel.matrix]
    agreement = next(one for one in found if one.kind == "agreement").lead
    for kind in ("false_pass", "false_fail"):
        assert f"{classes.count(kind)} {kind.replace('_', ' ')}" in agreement
    compared = [entry for entry in panel.matrix if entry.reference_class]
    of_baselines = sum(panel.row(entry.row).kind == "baseline" for entry in compared)
    assert of_baselines
    assert f"of {len(compared)} answers, {of_baselines} of them of baselines, agree" in agreement
    for kind in ("false_pass", "false_fail"):
        assert sum(one.entries for one in found if one.kind == kind) == classes.count(kind)
    raw = copy.deepcopy(raw_of("full"))
    for entry in raw["matrix"]:
        entry["reference_class"] = None
    silent = panel_from(raw)
    assert "missing" in [one.kind for one in findings_of(silent, trust_of(silent))]


def test_what_has_no_verdict_is_not_among_the_gaps():
    panel = panel_of("every verdict")
    judged = {(one.row, one.cell): one.verdict for one in panel.verdicts}
    declared, others = ([line.leads_to for line in b.lines] for b in gap_forest(panel).blocks)
    assert {judged[pair] for pair in declared} == {"fails", "transfers", "inconclusive"}
    assert not set(others) & set(judged)
    cells = {cell for _, cell in others}
    assert not cells & {IMPOSSIBLE, SLOW}
    assert UNKNOWN in cells
    assert gap_forest(panel_of("nothing learned")) is None


def test_parts_add_up_to_the_loss():
    for name in ("full", "every verdict"):
        panel = panel_of(name)
        losses = [(entry.home_drop, entry) for entry in panel.matrix if entry.home_drop is not None]
        assert len(losses) > 30
        for total, own in [*losses, *((judged.total, judged) for judged in panel.verdicts)]:
            parts = (own.difficulty, own.deadline, own.overfitting)
            assert sum(part.estimate for part in parts) == pytest.approx(total.estimate)


def test_a_given_policy_is_held_against_itself_cell_by_cell():
    """A mark is filled where the adjusted p-value is below 0.05."""
    panel = panel_of("given")
    success, earned = paired_success(panel), paired_return(panel)
    lines = success.blocks[0].lines
    assert [line.cell for line in lines] == [panel.label(one.cell) for one in panel.paired]
    filled = [line.marks[0].filled for line in lines]
    assert filled == [one.p_success_adjusted < 0.05 for one in panel.paired]
    assert any(filled)
    assert not all(filled)
    assert not any(line.marks[0].filled for line in earned.blocks[0].lines)
    assert len(earned.blocks[0].lines) == sum(one.returns is not None for one in panel.paired)
    assert paired_success(panel_of("full")) is None
    assert "paired" not in page_of("full").values("id")


def test_ladders_keep_control_periods_and_engines_apart():
    """Of engines that a row was not trained on there is none."""
    raw = copy.deepcopy(raw_of("full"))
    for cell in raw["cells"]:
        if cell["integrator"] == "implicit_midpoint":
            cell["engine"] = "mujoco"
    panel = panel_from(raw)
    labels = [group.label for group in panel.groups]
    assert labels[0] == "truth"
    assert set(labels[1:]) == {*SCHEMES, "mujoco implicit_midpoint"} - {"implicit_midpoint"}
    assert [cell.dt for cell in panel.groups[1].cells] == sorted(STEPS, reverse=True)
    for ladder in ladders_of(panel):
        assert "rk4" in ladder.fixed
        assert "mujoco implicit_midpoint" not in ladder.fixed
        for rungs in ladder.fixed.values():
            assert list(rungs) == sorted(rungs, reverse=True)
            assert {panel.cell(own.cell).control_period for own in rungs.values()} == {PERIOD}
    following = ladders_of(panel)[0].following
    assert set(following) == {*SCHEMES} - {"implicit_midpoint"}
    for rungs in following.values():
        assert all(panel.cell(own.cell).control_period == dt for dt, own in rungs.items())


def test_checks_compare_the_same_discretization():
    panel = panel_of("full")
    checks = checks_of(panel)
    assert list(checks) == ["mass +20 %", "latency 50 ms"]
    for before, after in itertools.chain(*checks.values()):
        one, other = panel.cell(before.cell), panel.cell(after.cell)
        assert (before.row, one.integrator, one.dt) == (after.row, other.integrator, other.dt)


@pytest.fixture(scope="module")
def swept():
    """A panel whose latency takes two values, one of them its own."""
    raw = copy.deepcopy(raw_of("full"))
    raw["spec"]["variations"].append(
        {"name": "none", "changes": {"action_latency": 0.0}, "at": ["home", "truth"]}
    )
    return panel_from(raw)


def test_every_row_that_learned_has_a_curve_through_its_own_entries(swept):
    plots = sweep_plots(swept)
    ((argument, (on_truth, at_home)),) = plots.rows
    assert (argument, on_truth.about, at_home.about) == (
        "action_latency", "on the truth", "at home",
    )  # fmt: skip
    assert len(set(plots.schemes.values())) == len(plots.schemes) > 1
    for plot in (on_truth, at_home):
        assert plot.along == "action_latency, s"
        assert [text for _, text in plot.ticks] == ["0", "0.05"]
        assert plot.series
        for series in plot.series:
            home = next(iter(swept.row(series.name).shares))
            cell = swept.truth.name if plot is on_truth else home
            first, last = series.points
            assert (first.x, last.x) == (0.0, 1.0)
            assert first.value == swept.entry(series.name, cell).success
            later = f"{cell}, latency 50 ms"
            assert last.value == swept.entry(series.name, later).success


def test_a_sweep_is_shown_apart_from_other_variations(swept):
    assert list(checks_of(swept)) == ["mass +20 %"]
    assert 'id="sweeps"' in render(swept)
    assert 'id="sweeps"' not in render(panel_of("full"))
    describe, draws = FIGURES["sweeps"]
    for draw in draws:
        assert "action_latency, s" in {axes.get_xlabel() for axes in draw(describe(swept)).axes}
