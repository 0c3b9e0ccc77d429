"""Nothing that happens to a run, by accident or on purpose, changes a result unnoticed.

`benchmarks/attacks.py` tries the same attacks as often as is wanted.
"""

from __future__ import annotations

import pytest
from damage import DAMAGES
from forgery import FORGERIES
from hostile import HOSTILE
from interruption import INTERRUPTIONS
from trials import ATTACKS, tried

FILES = [f"file {kind}" for kind in DAMAGES]
PLAIN = list(FORGERIES)
FITTING = [f"{kind}, all made to fit" for kind in FORGERIES]
STRANGERS = [f"hostile {kind}" for kind in HOSTILE]


def _holds(name, seeds, victim, folder):
    for seed in seeds:
        outcome = tried(name, seed, victim, folder / "try")
        assert outcome.held, (seed, outcome)


def test_every_attack_is_tried():
    assert list(ATTACKS) == [*FILES, *PLAIN, *FITTING, *STRANGERS, *INTERRUPTIONS]


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
    _holds(name, range(40), victim, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", INTERRUPTIONS)
def test_a_disturbed_run_is_finished_without_loss(name, victim, tmp_path):
    _holds(name, range(2 if name == "killed" else 1), victim, tmp_path)
