"""What a page is given to simulate with."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from report_episodes import network, told_of
from report_pages import Page, panel_of

from integ_gym.envs.settings import NATIVE
from integ_gym.eval.panel.result import Policy
from integ_gym.eval.report.episodes import MOST_POLICIES, policy_read
from integ_gym.eval.report.page import render
from integ_gym.train.policy_files.writing import save_policy


@pytest.fixture
def told(tmp_path: Path) -> Policy:
    """What a panel says of a policy whose file lies in the test's directory."""
    policy = network(np.random.default_rng(0))
    save_policy(policy, tmp_path / "policy.safetensors", "IntegPendulum-v0", home=None)
    return Policy(id="mine", seed=0, hash=policy.content_hash, file="policy.safetensors")


def test_a_policy_is_read_if_it_is_the_one_that_was_judged(told: Policy, tmp_path: Path) -> None:
    found = policy_read(told, tmp_path)
    assert found is not None
    assert found.content_hash == told.hash
    other = Policy(id="mine", seed=0, hash="0" * 64, file=told.file)
    assert policy_read(other, tmp_path) is None
    (tmp_path / "policy.safetensors").write_bytes(b"broken")
    assert policy_read(told, tmp_path) is None
    assert policy_read(told, tmp_path / "elsewhere") is None


def test_networks_that_the_page_cannot_evaluate_are_left_out(tmp_path: Path) -> None:
    for name, policy in {
        "gelu": replace(network(np.random.default_rng(0)), activation="GELU"),
        "large": network(np.random.default_rng(0), 256),
    }.items():
        save_policy(policy, tmp_path / f"{name}.safetensors", "IntegPendulum-v0", home=None)
        said = Policy(id=name, seed=0, hash=policy.content_hash, file=f"{name}.safetensors")
        assert policy_read(said, tmp_path) is None


def test_a_page_says_what_it_simulates_and_what_is_recorded_only() -> None:
    panel = panel_of("full")
    live = told_of(panel).live
    assert live is not None
    assert 1 <= len(live.policies) <= MOST_POLICIES
    native = {cell.name for cell in panel.columns if cell.engine == NATIVE}
    assert set(live.scripts) == native
    page = Page(render(panel, told_of(panel)))
    head, numbers = page.carried
    assert len(head["live"]["policies"]) == len(live.policies)
    places = [layer[2] for policy in head["live"]["policies"] for layer in policy["layers"]]
    assert 0 <= min(places) <= max(places) < len(numbers)
    assert "this browser recomputes them" in page.text
    for cell in panel.columns:
        if cell.name not in native:
            assert cell.name in page.text.partition("recorded only: ")[2].partition(".")[0]
