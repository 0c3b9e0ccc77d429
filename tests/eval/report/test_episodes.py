"""Which episodes a page leads with, and what it is given to simulate with."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from report_pages import Page, episodes_of, network, panel_from, panel_of, raw_of

from integ_gym.envs.settings import NATIVE
from integ_gym.eval.panel.conclusions import finding_of
from integ_gym.eval.panel.result import Panel, Policy
from integ_gym.eval.report.episodes import (
    MOST_POLICIES,
    Outcomes,
    choice_words,
    choose_episodes,
    read_network,
)
from integ_gym.eval.report.page import render
from integ_gym.eval.statistics import Estimate
from integ_gym.train.policy_files.writing import save_policy


def outcomes_of(panel: Panel, episodes: int = 4) -> dict[tuple[str, str], Outcomes]:
    """Everything succeeds everywhere, and the numerics do nothing."""
    outcomes = {}
    for entry in panel.matrix:
        shape = (len(panel.row(entry.row).policies), episodes)
        labels, traced = np.full(shape, "none", "<U24"), np.ones(shape, bool)
        own = Outcomes(labels, np.zeros((3, *shape)), np.ones(shape), traced)
        outcomes[entry.row, entry.cell] = own
    return outcomes


def test_the_first_film_shows_why_a_policy_fails() -> None:
    """The start whose success at home hangs most on the numerics, and where else it fails."""
    panel = panel_of("full")
    outcomes = outcomes_of(panel)
    first = choose_episodes(panel, outcomes)[0]
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
    lead = choose_episodes(panel, outcomes)[0]
    assert (lead.row, lead.cell, lead.seed, lead.episode) == (row, cell, 0, 2)
    assert lead.cells[:4] == (home, cell, third, fourth)
    assert set(lead.cells) == set(first.cells)


def test_without_a_family_the_first_film_is_of_the_largest_loss_that_says_something() -> None:
    """Losses where nobody succeeds in time judge the simulator, however large they are."""
    panel = msgspec.structs.replace(panel_of("full"), verdicts=())
    first = panel.exploratory[0]
    raised = Estimate(first.overfitting.estimate + 1.0)
    lost = next(cell.name for cell in panel.columns if cell.achievability == "unachievable")
    matrix = tuple(
        msgspec.structs.replace(entry, overfitting=raised) if entry.cell == lost else entry
        for entry in panel.matrix
    )
    for one in (panel, msgspec.structs.replace(panel, matrix=matrix)):
        leads = choose_episodes(one, outcomes_of(one))
        assert (leads[0].row, leads[0].cell) == (first.row, first.cell)
    assert all(lost not in lead.cells[:3] for lead in leads)
    assert "declared family" not in choice_words(panel)
    assert "declared family" in choice_words(panel_of("full"))


@pytest.mark.parametrize(("lost", "kind"), [(0.0, "held"), (0.6, "worst")])
def test_the_first_film_shows_what_the_first_line_says(lost: float, kind: str) -> None:
    """Home beside the truth: a start that holds where nothing is lost, else one that fails."""
    raw = copy.deepcopy(raw_of("given"))
    home, truth = "explicit_euler dt=0.05", "reference dt=0.05"
    raw["rows"][0].update(home=home, shares={home: 1.0})
    for one in raw["paired"]:
        if one["cell"] == truth:
            one["success"] = {"estimate": lost, "low": lost, "high": lost, "level": 0.95}
            one["p_success"] = 0.001 if lost else 1.0
    panel = panel_from(raw)
    outcomes = outcomes_of(panel)
    row = panel.rows[0].name
    outcomes[row, truth].label[0, 1] = "discretization_error"
    first, finding = choose_episodes(panel, outcomes)[0], finding_of(panel)
    assert finding is not None
    assert (first.row, first.cell) == (finding.row, finding.cell) == (row, truth)
    assert first.cells[:2] == (finding.home, truth)
    assert first.kind == kind
    assert (first.episode == 1) == (kind == "worst")


def test_a_policy_is_carried_if_it_was_judged_and_the_page_can_evaluate_it(tmp_path: Path) -> None:
    simple = network(np.random.default_rng(0))
    policies = {
        "simple": simple,
        "gelu": replace(simple, activation="GELU"),
        "large": network(np.random.default_rng(0), 256),
    }
    told = {}
    for name, policy in policies.items():
        save_policy(policy, tmp_path / f"{name}.safetensors", "IntegPendulum-v0", home=None)
        told[name] = Policy(id=name, hash=policy.content_hash, file=f"{name}.safetensors")
    found = read_network(told["simple"], tmp_path)
    assert found is not None
    assert found.content_hash == simple.content_hash
    assert read_network(told["gelu"], tmp_path) is None
    assert read_network(told["large"], tmp_path) is None
    other = Policy(id="other", hash="0" * 64, file="simple.safetensors")
    assert read_network(other, tmp_path) is None
    assert read_network(told["simple"], tmp_path / "elsewhere") is None
    (tmp_path / "simple.safetensors").write_bytes(b"broken")
    assert read_network(told["simple"], tmp_path) is None


def test_a_page_says_what_it_simulates_and_what_is_recorded_only() -> None:
    panel = panel_of("full")
    episodes = episodes_of(panel)
    live = episodes.live
    assert live is not None
    assert 1 <= len(live.policies) <= MOST_POLICIES
    native = {cell.name for cell in panel.columns if cell.engine == NATIVE}
    assert set(live.scripts) == native
    page = Page(render(panel, episodes))
    head, numbers = page.carried
    assert len(head["live"]["policies"]) == len(live.policies)
    places = [layer[2] for policy in head["live"]["policies"] for layer in policy["layers"]]
    assert 0 <= min(places) <= max(places) < len(numbers)
    assert "this browser recomputes them" in page.text
