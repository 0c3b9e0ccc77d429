"""What else is shared: stable-baselines3's training, and the evaluation of one policy."""

from __future__ import annotations

import pytest
from shared_panel import assert_equal_records
from victim import Victim, make_victim

from integ_gym.cli import main

OWN = "shared_panel:two_processes"


@pytest.fixture(scope="session")
def victim(made_once) -> Victim:
    """A finished panel of stable-baselines3's, and an evaluation of one of its policies."""
    return Victim(made_once("victim", make_victim))


@pytest.mark.slow
def test_stable_baselines3_trains_for_a_worker_as_for_a_driver(victim, tmp_path):
    run = tmp_path / "run"
    words = [*victim.panel.given(run, 1), "--worker"]
    assert main(words) == 0
    assert_equal_records(run, victim.run)


@pytest.mark.slow
def test_an_evaluation_on_an_executor_has_the_same_records(victim, tmp_path):
    run = tmp_path / "run"
    words = [*victim.evaluation.given(run, 2), "--executor", OWN]
    assert main(words) == 0
    assert_equal_records(run, victim.evaluation.done)
