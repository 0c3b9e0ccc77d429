"""Nothing that happens to a run, by accident or on purpose, changes a result unnoticed.

`benchmarks/attacks.py` tries the same attacks as often as is wanted.
"""

from __future__ import annotations

import pytest
from damage import DAMAGES
from forgery import FORGERIES
from hostile import HOSTILE
from interruption import INTERRUPTIONS
from trials import tried
from victim import Victim, make_victim

FILES = [f"file {kind}" for kind in DAMAGES]
PLAIN = list(FORGERIES)
FITTING = [f"{kind}, all made to fit" for kind in FORGERIES]
STRANGERS = [f"hostile {kind}" for kind in HOSTILE]


@pytest.fixture(scope="session")
def victim(made_once):
    """Finished runs, of which every try has a copy of its own."""
    return Victim(made_once("victim", make_victim))


def _holds(name, seeds, victim, folder):
    for seed in seeds:
        outcome = tried(name, seed, victim, folder / "try")
        assert outcome.held, (seed, outcome)


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_a_damaged_file_is_named_and_nothing_is_made_of_it(name, victim, tmp_path):
    _holds(name, range(1), victim, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*PLAIN[:1], *FITTING])
def test_a_forgery_is_named_and_nothing_is_made_of_it(name, victim, tmp_path):
    _holds(name, range(1), victim, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", STRANGERS)
def test_what_a_stranger_gives_is_read_or_refused(name, victim, tmp_path):
    _holds(name, range(15 if name == "hostile record" else 25), victim, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", INTERRUPTIONS)
def test_a_disturbed_run_is_finished_without_loss(name, victim, tmp_path):
    _holds(name, range(2 if name == "killed" else 1), victim, tmp_path)
