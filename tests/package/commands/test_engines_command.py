"""``integ-gym engines``."""

from __future__ import annotations

import json
import re
from itertools import takewhile

import pytest
from engine_cases import COMPILING, FOREIGN, needs

from integ_gym.cli import main
from integ_gym.envs import numerics
from integ_gym.envs.engines.stepping import missing_modules
from integ_gym.envs.numerics.identity import fingerprint
from integ_gym.envs.registries import ENGINES


def _table(printed):
    """Rows of the printed table, each {heading: cell}."""
    headings, _, *lines = [re.split(r" {2,}", line.strip()) for line in printed.splitlines()]
    return [dict(zip(headings, line, strict=True)) for line in lines if len(line) > 1]


@pytest.mark.parametrize(
    "engine",
    [
        pytest.param(engine, marks=pytest.mark.slow) if engine in COMPILING else engine
        for engine in FOREIGN
    ],
)
def test_every_integrator_of_an_engine_has_its_line(engine, capsys, monkeypatch):
    """With the map that it is declared to apply in the column of what it was found to apply."""
    needs(engine)
    found = {}

    def kept(engine, own, plant):
        found[own] = fingerprint(engine, own, plant)
        return found[own]

    monkeypatch.setattr(numerics, "fingerprint", kept)
    assert main(["engines", "--engine", engine]) == 0
    rows = _table(capsys.readouterr().out)
    assert {row["engine"] for row in rows} == {engine}
    assert {row["integrator"]: row["applies"] for row in rows} == ENGINES.load(engine).maps
    assert {measured.plant for measured in found.values()} == {"cart_pole"}
    for row in rows:
        volume = found[row["integrator"]].volume_defect
        assert float(row["det J - 1"]) == pytest.approx(volume, rel=0.5)


def test_a_narrow_terminal_is_told_the_same(capsys, monkeypatch):
    """By engine, with what its integrators have in common in a title."""
    engines = [
        name for name in ("native", "casadi", "drake", "mujoco") if not missing_modules(name)
    ]
    given = ["engines", "--engine", *engines]
    assert main(given) == 0
    rows = _table(capsys.readouterr().out)
    monkeypatch.setenv("COLUMNS", "80")
    assert main(given) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    for row in rows:
        (at,) = (k for k, line in enumerate(lines) if line.startswith(f"{row['engine']} "))
        assert lines[at].startswith(f"{row['engine']} {row['version']}, {row['bits']} bits, ")
        own = lines[at].endswith(", own stops") or f" {row['integrator']}" in lines[at]
        assert own == (row["own stops"] == "yes")
        widths = list(map(len, next(filter(re.compile("---").match, lines)).split()))
        assert [row[name] for name in _ROW] in _rows(lines[at + 1 :], widths)


_ROW = ("integrator", "applies", "off by", "det J - 1", "order", "frequency %", "energy %/s")


def _rows(lines, widths):
    """Cells of the lines up to the next title, those that go on in the next line put together."""
    second, third = widths[0] + 2, widths[0] + widths[1] + 4
    found = []
    for line in takewhile(str.strip, lines):
        names = line[:second].strip(), line[second:third].strip()
        numbers = line[third:].split()
        if numbers:
            found.append([*names, *numbers])
        else:
            found[-1][:2] = [upper + lower for upper, lower in zip(found[-1], names, strict=False)]
    return found


@pytest.mark.parametrize("given", [[], ["--json"]], ids=["table", "json"])
def test_what_a_step_cannot_violate_is_said(given, capsys):
    assert main(["engines", "--engine", "native", *given]) == 0
    assert "not applicable: generalized coordinates" in capsys.readouterr().out


def test_the_document_has_everything_measured(capsys):
    assert main(["engines", "--engine", "native", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    found = {entry["integrator"]: entry for entry in document["installed"]}
    assert found["rk4"]["map"] == "rk4"
    assert found["rk4"]["order"] == pytest.approx(4.0, abs=0.05)
    assert found["explicit_euler"]["energy_rate"] > 0.2
    assert found["implicit_euler"]["energy_rate"] < -0.2
    assert document["missing"] == {}


def test_what_is_missing_is_named_with_its_remedy(capsys, monkeypatch):
    monkeypatch.setattr(ENGINES.load("mujoco"), "modules", ("no_such_module",))
    assert main(["engines", "--engine", "native", "mujoco"]) == 0
    out = capsys.readouterr().out
    assert 'no_such_module); run: pip install -e ".[mujoco]"' in out


def test_an_unknown_engine_is_refused(capsys):
    assert main(["engines", "--engine", "mujco"]) == 2
    assert "Did you mean 'mujoco'?" in capsys.readouterr().err
