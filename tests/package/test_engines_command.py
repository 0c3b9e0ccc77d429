"""``integ-gym engines``."""

from __future__ import annotations

import json
import re
from functools import cache

import pytest
from engine_cases import needs

from integ_gym.cli import main
from integ_gym.envs import numerics
from integ_gym.envs.numerics.identity import fingerprint
from integ_gym.envs.registries import ENGINES


def _table(printed):
    """Rows of the printed table, each {heading: cell}."""
    headings, _, *lines = [re.split(r" {2,}", line.strip()) for line in printed.splitlines()]
    return [dict(zip(headings, line, strict=True)) for line in lines if len(line) > 1]


@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
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


@pytest.fixture(scope="module")
def of_native():
    """Runs the command on the native engine, whose steps are measured once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(numerics, "fingerprint", cache(fingerprint))
        yield lambda *more: main(["engines", "--engine", "native", *more])


def test_the_document_has_everything_measured(of_native, capsys):
    assert of_native("--json") == 0
    printed = capsys.readouterr().out
    assert "not applicable: generalized coordinates" in printed
    document = json.loads(printed)
    found = {entry["integrator"]: entry for entry in document["installed"]}
    assert found["rk4"]["map"] == "rk4"
    assert found["rk4"]["order"] == pytest.approx(4.0, abs=0.05)
    assert found["explicit_euler"]["energy_rate"] > 0.2
    assert found["implicit_euler"]["energy_rate"] < -0.2
    assert document["missing"] == {}


def test_what_is_missing_is_named_with_its_remedy(of_native, capsys, monkeypatch):
    monkeypatch.setattr(ENGINES.load("mujoco"), "modules", ("no_such_module",))
    assert of_native("mujoco") == 0
    out = capsys.readouterr().out
    assert 'no_such_module); run: pip install -e ".[mujoco]"' in out


def test_an_unknown_engine_is_refused(capsys):
    assert main(["engines", "--engine", "mujco"]) == 2
    assert "Did you mean 'mujoco'?" in capsys.readouterr().err
