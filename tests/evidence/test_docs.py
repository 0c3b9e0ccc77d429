"""docs/reference/evidence.md says what the code does."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from integ_gym.envs.registries import PLANTS, TASKS
from integ_gym.evidence.fields import (
    LABELS,
    SCHEMA_VERSION,
    SUMMARY_FIELDS,
    trace_fields,
)
from integ_gym.evidence.store import open_run

TEXT = (Path(__file__).parents[2] / "docs" / "reference" / "evidence.md").read_text(
    encoding="utf-8"
)


def _blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("field", SUMMARY_FIELDS, ids=lambda field: field.name)
def test_table_of_fields(field):
    kind = f"{field.kind}, not hashed" if field.volatile else field.kind
    meaning = field.meaning.replace("|", "\\|")
    assert f"\n| `{field.name}` | {kind} | {field.unit or '–'} | {meaning} |\n" in TEXT


def test_table_of_the_trace():
    task = TASKS.load("pendulum_swing_up")
    for field in trace_fields(PLANTS.load(task.plant), task):
        line = f"| `{field.name}` | {field.kind} | {field.unit} | {field.at} | {field.meaning} |"
        assert f"\n{line}\n" in TEXT


def test_no_other_fields_are_listed():
    rows = re.findall(
        r"^\| `(\w+)` \| (?:string|json|bool|int|float|time|list)", TEXT, re.MULTILINE
    )
    task = TASKS.load("pendulum_swing_up")
    fields = (*SUMMARY_FIELDS, *trace_fields(PLANTS.load(task.plant), task))
    assert sorted(rows) == sorted(field.name for field in fields)


@pytest.mark.parametrize("label", LABELS)
def test_labels_are_listed(label):
    assert f"\n| `{label}` |" in TEXT


def test_labels_are_listed_in_the_order_of_their_rules():
    rules = TEXT.partition("## Failure labels")[2].partition("\n## ")[0]
    listed = re.findall(r"^\| `(\w+)` \|", rules, re.MULTILINE)
    assert listed == ["evaluation_error", "none", *(x for x in LABELS if x not in listed[:2])]


def test_fields_are_listed_by_group_in_their_order():
    listed = re.findall(r"^(?:\*\*(\w+)\*\*$|\| `(\w+)` \| \S+ )", TEXT, re.MULTILINE)
    first = next(i for i, (group, _) in enumerate(listed) if group)
    expected = []
    for field in SUMMARY_FIELDS:
        if (field.group, "") not in expected:
            expected.append((field.group, ""))
        expected.append(("", field.name))
    assert listed[first : first + len(expected)] == expected


def test_the_schema_version_is_told():
    assert f"The schema version, {SCHEMA_VERSION} now, is in every file's metadata" in TEXT
    groups = {2: {"replays"}, 3: {"arrival"}, 4: set(), 5: {"outcome"}}
    for version in range(2, SCHEMA_VERSION + 1):
        later = {field.group for field in SUMMARY_FIELDS if field.since == version}
        assert later == groups[version]
    text = " ".join(TEXT.split())
    assert "Version 2 brought the group *replays* and the labels" in text
    assert "version 3 the group *arrival*" in text


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
    assert steps.num_rows == 5
    residuals = [abs(x) for x in steps.column("energy_residual").to_pylist()]
    assert residuals == sorted(residuals, reverse=True)


def test_plant_parameter_can_be_queried(two_environments):
    (expression,) = re.findall(r"`(CAST\(arguments.*?)`", TEXT)
    table = open_run(two_environments).query(f"SELECT DISTINCT {expression} AS mass FROM records")
    assert sorted(table.column("mass").to_pylist()) == [0.1, 1.0]
