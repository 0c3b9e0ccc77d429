"""Which episodes a page leads with."""

from __future__ import annotations

import copy

import msgspec
import numpy as np
import pytest
from report_pages import panel_from, panel_of, raw_of

from integ_gym.eval.panel.conclusions import finding_of
from integ_gym.eval.panel.result import Estimate, Panel
from integ_gym.eval.report.episodes import Outcomes, chosen, chosen_words

EPISODES = 4


def outcomes_of(panel: Panel) -> dict[tuple[str, str], Outcomes]:
    """Everything succeeds everywhere, and the numerics do nothing."""
    found = {}
    for entry in panel.matrix:
        shape = (len(panel.row(entry.row).policies), EPISODES)
        labels, traced = np.full(shape, "none", "<U24"), np.ones(shape, bool)
        found[entry.row, entry.cell] = Outcomes(
            labels, np.zeros((3, *shape)), np.ones(shape), traced
        )
    return found


def test_the_first_film_shows_why_a_policy_fails() -> None:
    """The start whose success at home hangs most on the numerics, and where else it fails."""
    panel = panel_of("full")
    outcomes = outcomes_of(panel)
    first = chosen(panel, outcomes)[0]
    row, cell, home = first.row, first.cell, first.cells[0]
    assert home != cell
    third, fourth = [x for x in first.cells[2:] if panel.cell(x).achievability == "achievable"][-2:]
    own, at_home = outcomes[row, cell], outcomes[row, home]
    own.label[0, 1:] = "discretization_error"
    at_home.label[0, 3] = "control_error"
    # Rounding here is no reason; what the numerics gave at home and not here is one.
    own.ledger[1, 0] = [0.0, 3e-11, 1e-11, 2e-11]
    at_home.ledger[1, 0] = [0.0, 0.5, -2.0, 9.0]
    outcomes[row, third].label[0] = "discretization_error"
    outcomes[row, fourth].ledger[1, 0] = 50.0
    lead = chosen(panel, outcomes)[0]
    assert (lead.row, lead.cell, lead.seed, lead.episode) == (row, cell, 0, 2)
    assert lead.cells[:4] == (home, cell, third, fourth)
    assert set(lead.cells) == set(first.cells)


def test_without_a_family_the_first_film_is_of_the_largest_loss_that_says_something() -> None:
    """Losses where nobody succeeds in time judge the simulator, however large they are."""
    panel = msgspec.structs.replace(panel_of("full"), verdicts=())
    leads = chosen(panel, outcomes_of(panel))
    first = panel.exploratory[0]
    assert (leads[0].row, leads[0].cell) == (first.row, first.cell)
    raised = Estimate(first.overfitting.estimate + 1.0)
    lost = next(cell.name for cell in panel.columns if cell.achievability == "unachievable")
    matrix = [
        msgspec.structs.replace(entry, overfitting=raised) if entry.cell == lost else entry
        for entry in panel.matrix
    ]
    again = msgspec.structs.replace(panel, matrix=tuple(matrix))
    leads = chosen(again, outcomes_of(again))
    assert (leads[0].row, leads[0].cell) == (first.row, first.cell)
    assert all(lost not in lead.cells[:3] for lead in leads)
    assert "of the 8 cells in which most success is lost" in chosen_words(panel)
    assert "of the declared family" in chosen_words(panel_of("full"))


def given_at_home(lost: float) -> Panel:
    """A given policy with a known home, which loses so much on the truth."""
    raw = copy.deepcopy(raw_of("given"))
    home, truth = "explicit_euler dt=0.05", "reference dt=0.05"
    raw["rows"][0].update(home=home, shares={home: 1.0})
    for one in raw["paired"]:
        if one["cell"] == truth:
            one["success"] = {"estimate": lost, "low": lost, "high": lost, "level": 0.95}
            one["p_success"] = 0.001 if lost else 1.0
    return panel_from(raw)


@pytest.mark.parametrize(("lost", "kind"), [(0.0, "held"), (0.6, "worst")])
def test_the_first_film_shows_what_the_first_line_says(lost: float, kind: str) -> None:
    """Home beside the truth: a start that holds where nothing is lost, else one that fails."""
    panel = given_at_home(lost)
    outcomes = outcomes_of(panel)
    row, truth = panel.rows[0].name, panel.truth
    assert truth is not None
    outcomes[row, truth.name].label[0, 1] = "discretization_error"
    first = chosen(panel, outcomes)[0]
    finding = finding_of(panel)
    assert finding is not None
    assert (first.row, first.cell) == (finding.row, finding.cell) == (row, truth.name)
    assert first.cells[:2] == (finding.home, truth.name)
    assert first.kind == kind
    assert (first.episode == 1) == (kind == "worst")
