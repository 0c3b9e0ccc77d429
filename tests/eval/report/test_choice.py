"""Which episodes a page leads with."""

from __future__ import annotations

import numpy as np
from report_pages import panel_of

from integ_gym.eval.panel.model import Panel
from integ_gym.eval.report.episodes.choice import chosen
from integ_gym.eval.report.episodes.outcomes import Outcomes

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
    third, fourth = [name for name in first.cells[2:] if name != cell][-2:]
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
