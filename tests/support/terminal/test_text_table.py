"""Tables and sentences keep to the terminal's width and lose nothing."""

from __future__ import annotations

import io

import pytest

from integ_gym.support.terminal import (
    beside,
    print_aligned,
    say,
    stands_in_columns,
    unbroken,
    width_of,
    wrapped,
)

REASON = "it never reached the goal, with 12% of the control steps saturated, over and over again"


def _printed(*given, **options):
    file = io.StringIO()
    print_aligned(*given, file, **options)
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
def test_nothing_is_lost_where_a_text_is_broken(text, width):
    lines = wrapped(text, width)
    assert max(map(len, lines)) <= width
    assert "".join(lines).replace(" ", "") == text.replace(" ", "")
    assert wrapped(text, None) == [text]


def test_a_text_is_broken_at_spaces_first():
    assert wrapped("of stormer_verlet and of rk4", 16) == ["of", "stormer_verlet", "and of rk4"]
    assert wrapped("two\nlines", 60) == ["two lines"]


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
    assert " ".join(line[18:] for line in lines[2:5]) == REASON


def test_names_of_columns_are_broken_before_cells(narrow):
    cells = ["x" * 20, "y" * 15, "z" * 15]
    lines = _printed(["a", "two words here", "energy at the end"], [cells])
    assert lines[-1].split() == cells
    assert max(map(len, lines)) <= 60


def test_too_many_columns_become_lists(narrow):
    names = [f"column {k}" for k in range(12)]
    lines = _printed(names, [["value"] * 12, ["value"] * 11 + [REASON]])
    assert lines[0] == "column 0   value"
    assert lines[12] == ""
    assert max(map(len, lines)) <= 60
    assert " ".join(line.strip() for line in lines[24:]) == f"column 11  {REASON}"


def test_a_text_beside_its_name_is_cut_where_it_takes_too_many_lines():
    whole = beside("why  ", REASON, 40)
    assert beside("why  ", REASON, 40, most=3) == whole
    assert beside("why  ", REASON, None, most=1) == f"why  {REASON}"
    first, last = beside("why  ", REASON, 40, most=2).splitlines()
    assert first == whole.splitlines()[0]
    assert last.endswith(" ...")
    assert len(last) <= 40


def test_columns_stand_side_by_side_if_their_cells_can_be_broken():
    assert stands_in_columns(["record", "why"], [["3f9a", REASON]], 40)
    assert not stands_in_columns(["one", "other"], [["3f9a" * 5, "x" * 30]], 40)


def test_too_many_columns_become_tables_that_repeat_the_keys(narrow):
    names = ["integrator", *(f"section {k}" for k in range(9))]
    rows = [["rk4", *(f"{k}/9" for k in range(9))], ["heun", *("long cell" for _ in range(9))]]
    lines = _printed(names, rows, keys=1)
    assert max(map(len, lines)) <= 60
    parts = "\n".join(lines).split("\n\n")
    assert len(parts) > 1
    found = [part.splitlines() for part in parts]
    told = [cell for part in found for line in part if line.startswith("rk4")
            for cell in line.split()[1:]]  # fmt: skip
    assert told == rows[0][1:]


def test_a_command_to_copy_stays_on_its_line(narrow):
    file = io.StringIO()
    command = 'pip install -e ".[mujoco_warp]"'
    say(f"mujoco_warp: not installed (warp, mujoco, more); run: {unbroken(command)}", file)
    lines = file.getvalue().splitlines()
    assert lines[-1] == f"  {command}"
    assert max(map(len, lines)) <= 60
