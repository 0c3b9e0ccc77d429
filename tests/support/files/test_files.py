"""What pages tell of paths: nothing of the machine beyond the folder that the reader stands in."""

from __future__ import annotations

from argparse import ArgumentTypeError
from pathlib import Path

import pytest

from integ_gym.support.files import display_path
from integ_gym.support.options import display_command, named_value, whole_number


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_path_is_told_from_here_or_by_its_name(here):
    assert display_path("runs/panel") == "runs/panel"
    assert display_path(here / "runs" / "panel") == "runs/panel"
    assert display_path(Path("/home/somebody/runs/panel")) == "panel"


def test_a_command_is_told_without_absolute_paths(here):
    words = ["integ-gym", "panel", "/a/b.toml", f"--out={here}/one two", "--home", "dt=0.05,x=/y"]
    told = "integ-gym panel b.toml '--out=one two' --home dt=0.05,x=/y"
    assert display_command(words) == told


def test_a_value_that_is_nested_too_deep_is_text():
    assert named_value("a=" + "[" * 100_000)[1].startswith("[[")


@pytest.mark.parametrize("word", ["1.5", "1e-3", "many", "nan", "1e999"])
def test_what_is_no_whole_number_is_refused(word):
    assert whole_number("2.5e3") == 2500
    with pytest.raises(ArgumentTypeError, match=f"expected a whole number.*{word}"):
        whole_number(word)
