"""A sweep is one curve for every row, on the truth and at home."""

from __future__ import annotations

import pytest
from report_example import full_panel
from report_pages import panel_from

from integ_gym.eval.report.drawing import draw_ladders
from integ_gym.eval.report.forests import checks_of
from integ_gym.eval.report.ladders import sweep_plots
from integ_gym.eval.report.page import render
from integ_gym.eval.report.paper import print_ladders


@pytest.fixture(scope="module")
def swept():
    """A panel whose latency is what a sweep changes; the name is the sweep's."""
    raw = full_panel()
    names = {"latency 50 ms": "action_latency=0.05"}
    for cell in raw["cells"]:
        cell["perturbation"] = names.get(cell["perturbation"], cell["perturbation"])
    raw["spec"]["sweeps"] = [{"argument": "action_latency", "values": [0.0, 0.05], "unit": "s"}]
    return panel_from(raw)


def test_every_row_that_learned_has_a_curve_through_its_own_entries(swept):
    ((argument, plots),) = sweep_plots(swept).rows
    assert argument == "action_latency"
    assert [plot.about for plot in plots] == ["on the truth", "at home"]
    for plot, place in zip(plots, (lambda row: swept.truth.name, _home), strict=True):
        assert plot.along == "action_latency, s"
        assert [text for _, text in plot.ticks] == ["0", "0.05"]
        assert plot.series
        for series in plot.series:
            cell = place(series.name, swept) if place is _home else place(series.name)
            first, last = series.points
            assert (first.x, last.x) == (0.0, 1.0)
            assert first.value == swept.entry(series.name, cell).success
            later = next(
                c.name for c in swept.cells
                if c.perturbation == "action_latency=0.05" and c.name.startswith(cell)
            )  # fmt: skip
            assert last.value == swept.entry(series.name, later).success


def _home(name, panel):
    return next(iter(panel.row(name).shares))


def test_rows_of_one_integrator_differ(swept):
    styles = list(sweep_plots(swept).schemes.values())
    assert len(set(styles)) == len(styles) > 1


def test_it_stands_on_the_page_and_not_among_the_perturbations(swept):
    assert "action_latency=0.05" not in checks_of(swept)
    page = render(swept)
    assert 'id="sweeps"' in page
    assert "action_latency, s" in page
    assert 'id="sweeps"' not in render(panel_from(full_panel()))


def test_it_is_drawn(swept):
    for draw in (draw_ladders, print_ladders):
        labels = {axes.get_xlabel() for axes in draw(sweep_plots(swept)).axes}
        assert "action_latency, s" in labels
