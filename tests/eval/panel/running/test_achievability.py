"""What was tried in a cell from the starts that came at a time, and from all of them."""

from __future__ import annotations

import json
from dataclasses import replace

import msgspec
import pytest

from integ_gym.eval.panel.achieve import tried
from integ_gym.eval.panel.evaluate import statuses
from integ_gym.eval.panel.run_directory import RunDirectory, RunDirectoryError
from integ_gym.eval.panel.spec import read_spec
from integ_gym.eval.verdict import Search

WHOLE = replace(read_spec("quick"), episodes=5, episode_parts=(3, 2))
CELL = WHOLE.columns()[0]


def _search(*highest):
    return msgspec.to_builtins(Search(24.0, 1.0, highest, "by trying"))


def _tried(tmp_path, *parts):
    directory = RunDirectory(tmp_path / "run", {"name": "run"})
    directory.make_folders()
    for first, success, search in parts:
        unit = f"achieve-cell-{first}"
        directory.finish(
            unit, "key", 0.0, first=first, cell=CELL.name, success=success, recovered=success,
            search=search,
        )  # fmt: skip
    return directory


def test_a_cell_is_judged_by_the_starts_that_there_were(tmp_path):
    """Each part's records are labelled by it and the parts before, the panel by all."""
    parts = (3, [1.0, 1.0], None), (0, [0.0, 0.0, 0.0], _search(0.1, 0.2, 0.3))
    directory = _tried(tmp_path, *parts)
    first, whole = WHOLE.parts()
    assert statuses(first, directory) == {CELL.name: "unachievable"}
    assert statuses(whole, directory) == {CELL.name: "undecided"}, "no search rules all of it out"
    assert tried(directory)[CELL.name].success == (0.0, 0.0, 0.0, 1.0, 1.0)


def test_searches_from_all_starts_rule_a_cell_out_together(tmp_path):
    parts = (0, [0.0], _search(0.1)), (3, [0.0, 0.0], _search(0.2, 2.0))
    directory = _tried(tmp_path, *parts)
    assert tried(directory)[CELL.name].search.highest == (0.1, 0.2, 2.0)
    assert statuses(WHOLE, directory) == {CELL.name: "unachievable"}


@pytest.mark.parametrize("change", [{}, {"first": "3"}])
def test_a_marker_says_which_starts_it_is_of(tmp_path, change):
    directory = _tried(tmp_path, (0, [1.0], None))
    (marker,) = (tmp_path / "run" / "units").glob("*.json")
    held = json.loads(marker.read_text())
    del held["first"]
    marker.write_text(json.dumps({**held, **change}))
    with pytest.raises(RunDirectoryError, match=r"is damaged: .*'first'"):
        tried(directory)
