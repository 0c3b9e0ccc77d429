"""Colours only where somebody sees them, and nobody has asked for none."""

from __future__ import annotations

import io

import pytest

from integ_gym.support.terminal import print_columns

ROWS = [("fails", "a"), ("transfers", "b"), ("fails as well", "c")]


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def printed(file: io.StringIO) -> str:
    print_columns(("verdict", "of"), ROWS, file, colours={"fails": "red", "transfers": "green"})
    return file.getvalue()


@pytest.fixture(autouse=True)
def plain_environment(monkeypatch):
    for name, value in (("TERM", "xterm"), ("COLUMNS", "80")):
        monkeypatch.setenv(name, value)
    monkeypatch.delenv("NO_COLOR", raising=False)


def test_whole_cells_are_painted_on_a_terminal():
    text = printed(Terminal())
    assert "\x1b[31mfails " in text
    assert "\x1b[32mtransfers " in text
    assert "\nfails as well" in text
    plain = text
    for code in ("\x1b[31m", "\x1b[32m", "\x1b[0m"):
        plain = plain.replace(code, "")
    assert plain == printed(io.StringIO())


@pytest.mark.parametrize(("name", "value"), [("NO_COLOR", "1"), ("TERM", "dumb")])
def test_nobody_who_asks_for_none_gets_them(name, value, monkeypatch):
    monkeypatch.setenv(name, value)
    assert "\x1b" not in printed(Terminal())


def test_a_file_gets_none():
    assert "\x1b" not in printed(io.StringIO())
