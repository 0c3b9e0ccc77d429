"""docs/reference/evidence.md says what the code does."""

from __future__ import annotations

import re
from pathlib import Path

from integ_gym.evidence.store import open_run

TEXT = (Path(__file__).parents[2] / "docs" / "reference" / "evidence.md").read_text("utf-8")


def _blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)


def test_examples_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in _blocks("python"):
        exec(compile(block, "docs/reference/evidence.md", "exec"), names)
    assert capsys.readouterr().out.count("(201,)") == 3
    store = open_run("runs/first-look")
    assert store.count() == 11
    assert store.verify() == []


def test_queries_run(two_environments):
    store = open_run(two_environments)
    by_discretization, failures, steps = (store.query(sql) for sql in _blocks("sql"))
    assert by_discretization.to_pylist()[0]["episodes"] == 6
    assert sum(failures.column("episodes").to_pylist()) == 6
    residuals = [abs(x) for x in steps.column("energy_residual").to_pylist()]
    assert residuals == sorted(residuals, reverse=True)
    (expression,) = re.findall(r"`(CAST\(arguments.*?)`", TEXT)
    table = store.query(f"SELECT DISTINCT {expression} AS mass FROM records")
    assert sorted(table.column("mass").to_pylist()) == [0.1, 1.0]
