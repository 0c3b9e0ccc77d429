"""The experiments beside the atlas: they run, and are told as found."""

import json

import pyarrow.parquet as pq
import pytest
from house import ROOT

EXPERIMENTS = (
    "curriculum", "fresh_points", "pendulum_periods", "q_learning_periods", "stop_damping",
)  # fmt: skip
EXPLANATION = ROOT / "docs" / "explanation"
PAGES = dict.fromkeys(EXPERIMENTS, EXPLANATION / "experiments.md")
PAGES["fresh_points"] = EXPLANATION / "atlas.md"
PAGES["stop_damping"] = EXPLANATION / "learned_engines.md"
PLACES = {"stop_damping": 2}
"""In how many environments a policy is judged, where it is not one."""


@pytest.fixture(params=EXPERIMENTS)
def experiment(request, import_experiment):
    """A script, and what it trains with."""
    return import_experiment(request.param), import_experiment("measuring.trained")


def test_the_page_tells_what_was_found(experiment):
    script, trained = experiment
    table, folder = script.TABLE, ROOT / "docs" / "tables" / script.__name__
    rows = pq.read_table(folder / "rows.parquet").to_pylist()
    asked = {(unit.name, seed) for unit in table.units(table.first_seed) for seed in unit.seeds}
    assert {(row["unit"], row["seed"]) for row in rows} == asked
    assert len(rows) == len(asked) * PLACES.get(script.__name__, 1)
    assert len({(*map(row.get, table.cell_columns), row["seed"]) for row in rows}) == len(rows)
    assert {row["starts"] for row in rows} == {trained.STARTS}
    found = json.loads((folder / "specification.json").read_text(encoding="utf-8"))
    specified = table.specification(table.first_seed)
    assert all(found[name] == specified[name] for name in ("declared", "columns"))
    page = PAGES[script.__name__].read_text(encoding="utf-8")
    for part in script.tables(rows).strip().split("\n\n"):
        assert part in page


def test_tests_are_shown_where_all_was_run_that_they_are_of(experiment):
    script, _ = experiment
    path = ROOT / "docs" / "tables" / script.__name__ / "rows.parquet"
    rows = pq.read_table(path).to_pylist()
    *_, last = script.tables(rows).split("\n\n")
    begun = script.tables([row for row in rows if row["unit"] != rows[-1]["unit"]])
    assert begun.count("\n") < script.tables(rows).count("\n")
    assert not script.TABLE.declared["tests"] or last.split("\n")[0] not in begun


@pytest.mark.slow
def test_every_arm_trains(experiment, monkeypatch):
    script, trained = experiment
    monkeypatch.setattr(trained, "TOGETHER", 2)
    if script.__name__ == "curriculum":
        monkeypatch.setitem(script.TRAINING, "total_steps", 16_384)
    elif script.__name__ == "fresh_points":
        monkeypatch.setitem(script._atlas().panel.training, "total_steps", 16_384)
    else:
        monkeypatch.setattr(script, "SECONDS", min(script.SECONDS / 10.0, 800.0))
    first = [unit for unit in script.TABLE.units(1900) if unit.first_seed == 1900]
    blocks = list(dict.fromkeys(unit.block for unit in first))
    for unit in first:
        if unit.block == blocks[-2]:
            rows = script.run(unit)
            places = PLACES.get(script.__name__, 1)
            assert [row["seed"] for row in rows] == [1900, 1901] * places
            assert {"unit", *rows[0]} == {*script.TABLE.specification(1900)["columns"]}
            assert all(0 <= row["successes"] <= trained.STARTS for row in rows)
