"""Tables and sentences keep to the terminal's width and lose nothing."""

from __future__ import annotations

import io

import pytest

from integ_gym.support.terminal import (
    hanging_indent,
    has_room,
    print_columns,
    print_wrapped,
    unbroken,
    width_of,
    wrap,
)

REASON = "it never reached the goal, with 12% of the control steps saturated, over and over again"


def _printed(*given, **options):
    file = io.StringIO()
    print_columns(*given, file, **options)
    return file.getvalue().splitlines()


@pytest.fixture
def narrow(monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")


def test_nobody_reads_a_file_line_by_line(narrow, monkeypatch):
    assert width_of(io.StringIO()) == 60
    monkeypatch.delenv("COLUMNS")
    assert width_of(io.StringIO()) is None


@pytest.mark.parametrize("text", [REASON, "a_" * 60, "x" * 100, '{"a":1.25,"b":[1,2]}' * 9, ""])
@pytest.mark.parametrize("width", [20, 33, 60])
def test_nothing_is_lost_where_a_text_is_broken(text, width, monkeypatch):
    assert wrap(text, io.StringIO()) == text
    monkeypatch.setenv("COLUMNS", str(width))
    lines = wrap(text, io.StringIO()).split("\n")
    assert max(map(len, lines)) <= width
    assert "".join(lines).replace(" ", "") == text.replace(" ", "")


def test_a_table_that_fits_is_printed_in_full(narrow):
    rows = [["rk4", "-1.5"], ["explicit_euler", "10"]]
    assert _printed(["integrator", "energy"], rows, right=[False, True]) == [
        "integrator      energy",
        "--------------  ------",
        "rk4               -1.5",
        "explicit_euler      10",
    ]


def test_long_texts_are_broken_within_their_column(narrow):
    lines = _printed(["record", "why"], [["3f9a" * 4, REASON], ["b", ""]])
    assert max(map(len, lines)) <= 60
    assert [line[:18].strip() for line in lines[2:]] == ["3f9a" * 4, "", "", "b"]
    assert " ".join(line[18:].strip() for line in lines[2:5]) == REASON


def test_too_many_columns_become_lists(narrow):
    names = [f"column {k}" for k in range(12)]
    lines = _printed(names, [["value"] * 12, ["value"] * 11 + [REASON]])
    assert lines[0] == "column 0   value"
    assert lines[12] == ""
    assert max(map(len, lines)) <= 60
    assert " ".join(line.strip() for line in lines[24:]) == f"column 11  {REASON}"


def test_a_text_beside_its_name_is_cut_where_it_takes_too_many_lines():
    whole = hanging_indent("why  ", REASON, 40)
    assert hanging_indent("why  ", REASON, 40, most=3) == whole
    assert hanging_indent("why  ", REASON, None, most=1) == f"why  {REASON}"
    first, last = hanging_indent("why  ", REASON, 40, most=2).splitlines()
    assert first == whole.splitlines()[0]
    assert last.endswith(" ...")
    assert len(last) <= 40


def test_columns_stand_side_by_side_if_their_cells_can_be_broken():
    assert has_room(["record", "why"], [["3f9a", REASON]], 40)
    assert not has_room(["one", "other"], [["3f9a" * 5, "x" * 30]], 40)


def test_a_command_to_copy_stays_on_its_line(narrow):
    file = io.StringIO()
    command = 'pip install -e ".[mujoco_warp]"'
    print_wrapped(
        f"mujoco_warp: not installed (warp, mujoco, more); run: {unbroken(command)}", file
    )
    lines = file.getvalue().splitlines()
    assert lines[-1] == f"  {command}"
    assert max(map(len, lines)) <= 60
