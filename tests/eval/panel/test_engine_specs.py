"""Specifications of several engines: what they expand to, and what is refused."""

import pytest
from engine_cases import ELSEWHERE, FOREIGN
from engines_panel import alike_data, trained_units
from small_panel import small_data

from integ_gym.cli import main
from integ_gym.envs.engines import stepping
from integ_gym.envs.engines.stepping import installed_engines, map_of, missing_modules
from integ_gym.eval.panel.cells import SpecError
from integ_gym.eval.panel.run import check_spec
from integ_gym.eval.panel.spec import parse_spec, read_spec
from integ_gym.eval.panel.units import training_key


def test_the_built_in_panel_asks_the_quick_panels_policies():
    quick, engines = read_spec("quick"), read_spec("engines")
    assert (engines.training, engines.environment) == (quick.training, quick.environment)
    assert (engines.train, engines.trainer) == (quick.train, quick.trainer)
    known = {unit.policy: training_key(quick, unit) for unit in trained_units(quick)}
    for unit in trained_units(engines):
        assert known[unit.policy] == training_key(engines, unit)
    for engine in set(installed_engines()) - {"native"}:
        maps = {(map_of(d.engine, d.integrator), d.dt) for d in engines.grid if d.engine == engine}
        assert maps
        assert {dt for _, dt in maps} == {0.05, 0.0125}
    assert set(installed_engines()) == {d.engine for d in engines.grid}


@pytest.mark.slow
def test_every_engine_takes_what_the_built_in_panel_asks():
    """Each is made, which those that compile take seconds for."""
    check_spec(read_spec("engines"))


def test_engines_that_are_not_installed_are_left_out_and_named(monkeypatch):
    absent = [name for k, name in enumerate(FOREIGN) if k % 2 == 0 or missing_modules(name)]
    absent = sorted([*absent, *ELSEWHERE])
    monkeypatch.setattr(stepping, "missing_modules", lambda name: [name] * (name in absent))
    spec = parse_spec(alike_data(), "test")
    assert not {d.engine for d in spec.grid} & set(absent)
    for engine in absent:
        command = f"make {engine}." if engine in ELSEWHERE else f".[{engine}]"
        assert any(command in gap for gap in spec.gaps())


def test_a_panel_about_engines_without_one_is_refused_in_one_line(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(stepping, "missing_modules", lambda name: [name] * (name != "native"))
    assert main(["panel", "engines", "--out", str(tmp_path / "out")]) == 2
    message = capsys.readouterr().err.strip()
    assert "\n" not in message
    assert 'run: pip install -e ".[mujoco]"' in message
    assert not (tmp_path / "out").exists()


def test_the_engine_that_is_named_as_missing_applies_what_was_asked(monkeypatch):
    monkeypatch.setattr(stepping, "missing_modules", lambda name: [name] * (name != "native"))
    data = alike_data()
    data["evaluate"][1]["map"] = "implicit_midpoint"
    with pytest.raises(SpecError, match=r'pip install -e "\.\[casadi\]"'):
        parse_spec(data, "test")


@pytest.mark.parametrize(
    ("entry", "fragments"),
    [
        ({"engine": "mujocco"}, ["unknown engine 'mujocco'", "Did you mean 'mujoco'"]),
        ({"engine": "mujoco"}, ["engine 'mujoco' has no integrator 'rk4'", "RK4"]),
        ({"engine": "dart"}, ["engine 'dart' has no integrator 'rk4'", "semi_implicit_euler"]),
        ({"engine": "installed"}, ["takes `map` in place of `integrator`", "symplectic_euler"]),
        ({"map": "rk4"}, ["needs `integrator` and `dt`, and no `map`"]),
    ],
)  # fmt: skip
def test_cells_that_no_engine_has_are_refused(entry, fragments):
    evaluate = [*small_data(compare=[])["evaluate"], {"integrator": "rk4", "dt": 0.05, **entry}]
    with pytest.raises(SpecError) as caught:
        parse_spec(small_data(compare=[], evaluate=evaluate), "panel.toml")
    for fragment in fragments:
        assert fragment in str(caught.value)
    assert "\n" not in str(caught.value)


def test_unknown_maps_are_refused():
    evaluate = [
        *small_data(compare=[])["evaluate"],
        {"engine": "installed", "map": "rk5", "dt": 0.05},
    ]
    with pytest.raises(SpecError, match="unknown map in `evaluate`"):
        parse_spec(small_data(compare=[], evaluate=evaluate), "panel.toml")
