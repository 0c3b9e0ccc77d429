"""``integ-gym engines``."""

from __future__ import annotations

import json

import pytest
from engine_cases import FIRST, needs

from integ_gym.cli import main
from integ_gym.envs import extras
from integ_gym.envs.engines import ENGINES


@pytest.mark.parametrize(("engine", "integrator"), FIRST)
def test_every_integrator_of_an_engine_has_its_line(engine, integrator, capsys):
    needs(engine)
    assert main(["engines", "--engine", engine, "--plant", "pendulum"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for own, applied in ENGINES.load(engine).maps.items():
        (line,) = [x for x in lines if x.split()[:3:2] == [engine, own]]
        assert any(name in line for name in (applied, "symplectic_euler_implicit_damping"))


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
    monkeypatch.setitem(extras.EXTRAS, "mujoco", ("no_such_module",))
    assert main(["engines", "--engine", "native", "mujoco"]) == 0
    out = capsys.readouterr().out
    assert 'no_such_module); run: pip install "integ-gym[mujoco]"' in out


def test_an_unknown_engine_is_refused(capsys):
    assert main(["engines", "--engine", "mujco"]) == 2
    assert "Did you mean 'mujoco'?" in capsys.readouterr().err
