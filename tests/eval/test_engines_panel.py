"""Panels on several engines: the same policy does the same; what is refused, kept and reused."""

from __future__ import annotations

import json
import shutil
import tomllib

import engines_panel
import numpy as np
import pytest
import small_panel
from engine_cases import FOREIGN, needs

from integ_gym.cli import main
from integ_gym.envs import extras
from integ_gym.envs.engines import ENGINES
from integ_gym.envs.extras import EXTRAS, missing_modules
from integ_gym.envs.versions import package_version
from integ_gym.eval import engine_cells, units
from integ_gym.eval.engine_cells import installed_engines, integrator_applying, map_of
from integ_gym.eval.expected_time import cell_seconds
from integ_gym.eval.panel import check_spec
from integ_gym.eval.spec import SpecError, built_in_spec, parse_spec
from integ_gym.eval.units import training_config, training_key, units_of
from integ_gym.evidence.store import EvidenceStore

PRECISE = ("mujoco", "drake", "pinocchio", "dart", "pybullet")
"""Engines with symplectic Euler in float64."""


def _small(**changes):
    return {**tomllib.loads(small_panel.TOML), "compare": [], **changes}


@pytest.fixture(scope="module")
def alike(tmp_path_factory):
    """Directory of a finished panel: one trained policy on every installed engine."""
    folder = tmp_path_factory.mktemp("engines")
    (folder / "alike.toml").write_text(engines_panel.TOML, encoding="utf-8")
    out = folder / "out"
    assert main(["panel", str(folder / "alike.toml"), "--out", str(out), "--no-progress"]) == 0
    return out


def _panel(directory):
    return json.loads((directory / "panel.json").read_text(encoding="utf-8"))


def _episodes(directory, engine):
    return (
        EvidenceStore(directory / "evidence")
        .query(
            "SELECT episode_index, initial_state, success, time, theta, theta_dot, engine_version "
            f"FROM records WHERE phase = 'evaluation' AND engine = '{engine}' AND dt = 0.05 "
            "AND integrator != 'reference' AND policy_id LIKE 'symplectic%' ORDER BY 1"
        )
        .to_pylist()
    )


@pytest.mark.slow
@pytest.mark.parametrize("engine", PRECISE)
def test_a_policy_does_the_same_on_every_engine(alike, engine):
    """Success of every episode is equal, trajectories agree to 1e-6 over the first second."""
    needs(engine)
    native, theirs = _episodes(alike, "native"), _episodes(alike, engine)
    assert len(native) == len(theirs) == 10
    assert np.mean([one["success"] for one in native]) >= 0.5
    for ours, other in zip(native, theirs, strict=True):
        assert ours["initial_state"] == other["initial_state"]
        assert ours["success"] == other["success"]
        assert other["engine_version"] == package_version(ENGINES.load(engine).package)
        first = np.array(ours["time"]) <= 1.0 + 1e-9
        assert first.sum() >= 20
        for name in ("theta", "theta_dot"):
            gap = np.array(ours[name])[first] - np.array(other[name])[first]
            assert np.abs(gap).max() <= 1e-6


@pytest.mark.slow
def test_the_page_says_on_which_engines_policies_do_the_same(alike):
    panel = _panel(alike)
    found = {one["engine"]: one for one in panel["engine_agreement"]}
    assert set(found) == {d["engine"] for d in panel["spec"]["grid"]} - {"native"}
    for engine, one in found.items():
        assert one["twin"] == "symplectic_euler dt=0.05"
        assert one["episodes"] == 20
        if engine in PRECISE:
            assert (one["differing"], one["largest"]) == (0, 0.0)
    assert panel["answer"].startswith(("Yes: on each of", "On "))
    page = (alike / "report.html").read_text(encoding="utf-8")
    for engine in found:
        assert engine in page
        assert panel["versions"][ENGINES.load(engine).package]


@pytest.mark.slow
def test_policies_of_a_finished_panel_are_used_again(alike, tmp_path, capsys):
    """With their training evidence and nothing trained; the results are the same."""
    spec = tmp_path / "again.toml"
    spec.write_text(
        engines_panel.TOML.replace('name = "alike"', 'name = "again"'), encoding="utf-8"
    )
    out = tmp_path / "out"
    command = ["panel", str(spec), "--out", str(out), "--no-progress", "--policies", str(alike)]
    assert main(command) == 0
    kept = [p.relative_to(out) for p in (out / "policies").rglob("*") if p.is_file()]
    kept += [p.relative_to(out) for p in out.glob("*/train-*")]
    assert len(kept) >= 5
    assert all((out / name).read_bytes() == (alike / name).read_bytes() for name in kept)
    assert EvidenceStore(out / "evidence").verify() == []
    assert "--policies" in _panel(out)["command"]
    assert [e["success_by_seed"] for e in _panel(out)["matrix"]] == [
        e["success_by_seed"] for e in _panel(alike)["matrix"]
    ]
    times = {p: p.stat().st_mtime_ns for p in (out / "units").glob("*")}
    assert main(command) == 0
    assert times == {p: p.stat().st_mtime_ns for p in times}
    (out / "policies" / kept[0].parts[1] / "policy.zip").unlink()
    assert main(command) == 0
    assert (out / "policies" / kept[0].parts[1] / "policy.zip").exists()
    capsys.readouterr()


def _refused(capsys, folder, toml, policies, *more):
    spec = folder / "wanted.toml"
    spec.write_text(toml, encoding="utf-8")
    out = folder / "refused"
    command = ["panel", str(spec), "--out", str(out), "--policies", str(policies), *more]
    assert main(command) == 2
    assert not out.exists()
    message = capsys.readouterr().err.strip()
    assert "\n" not in message
    return message


def test_policies_that_were_trained_otherwise_are_refused(panel_directory, tmp_path, capsys):
    toml, copy = small_panel.TOML, tmp_path / "copy"
    message = _refused(capsys, tmp_path, toml, tmp_path / "none")
    assert "holds no panel" in message
    shutil.copytree(panel_directory, copy)
    (copy / "units" / "train-rk4-dt-0.05-seed1.json").unlink()
    message = _refused(capsys, tmp_path, toml, copy)
    assert "no finished policy rk4-dt-0.05-seed1" in message
    longer = toml.replace("total_steps = 2048", "total_steps = 4096")
    assert "other hyperparameters" in _refused(capsys, tmp_path, longer, panel_directory)
    message = _refused(capsys, tmp_path, toml, panel_directory, "--trainer", "fleet")
    assert "from trainer 'sb3', this panel's from 'fleet' with jax" in message


def test_the_built_in_panel_asks_the_quick_panels_policies():
    quick, engines = built_in_spec("quick"), built_in_spec("engines")
    check_spec(engines)
    assert (engines.training, engines.environment) == (quick.training, quick.environment)
    assert (engines.train, engines.trainer) == (quick.train, quick.trainer)
    known = {unit.policy: training_key(training_config(quick, unit)) for unit in _trained(quick)}
    for unit in _trained(engines):
        assert known[unit.policy] == training_key(training_config(engines, unit))
    for engine in installed_engines():
        maps = {(map_of(d), d.dt) for d in engines.grid if d.engine == engine}
        assert maps
        assert {dt for _, dt in maps} == {0.05, 0.0125}
    assert {"native", *installed_engines()} == {d.engine for d in engines.grid}


def _trained(spec):
    return [unit for unit in units_of(spec) if unit.home is not None]


def test_engines_that_are_not_installed_are_left_out_and_named(monkeypatch):
    absent = [name for k, name in enumerate(FOREIGN) if k % 2 == 0 or missing_modules(name)]
    monkeypatch.setattr(engine_cells, "missing_modules", lambda name: [name] * (name in absent))
    spec = parse_spec(tomllib.loads(engines_panel.TOML), "test")
    assert spec.left_out == tuple(absent)
    assert not {d.engine for d in spec.grid} & set(absent)
    for engine in absent:
        assert any(f"integ-gym[{engine}]" in gap for gap in spec.gaps())


@pytest.mark.parametrize("engine", FOREIGN)
def test_a_missing_extra_is_one_line(engine, monkeypatch, tmp_path, capsys):
    """Of an engine that the specification names."""
    needs(engine)
    integrator = next(iter(ENGINES.load(engine).maps))
    spec = tmp_path / "spec.toml"
    cell = f'[[evaluate]]\nengine = "{engine}"\nintegrator = "{integrator}"\ndt = 0.05\n'
    spec.write_text(f"{small_panel.TOML}\n{cell}", encoding="utf-8")
    _hide(engine, monkeypatch)
    assert main(["panel", str(spec), "--out", str(tmp_path / "out")]) == 2
    message = capsys.readouterr().err.strip()
    assert "\n" not in message
    assert f'pip install "integ-gym[{engine}]"' in message
    assert not (tmp_path / "out").exists()


def _hide(engine, monkeypatch):
    """As if the modules of an engine's extra were not there."""
    hidden = EXTRAS[engine]

    def find(module, *arguments):
        if module.partition(".")[0] in hidden:
            raise ModuleNotFoundError(f"No module named {module!r}", name=module)
        return importlib_import(module, *arguments)

    importlib_import = extras.importlib.import_module
    monkeypatch.setattr(extras.importlib, "import_module", find)


@pytest.mark.parametrize(
    ("entry", "fragments"),
    [
        ({"engine": "mujocco"}, ["unknown engine 'mujocco'", "Did you mean 'mujoco'"]),
        ({"engine": "mujoco"}, ["unknown integrator of engine 'mujoco' 'rk4'", "RK4"]),
        ({"engine": "dart"}, ["unknown integrator of engine 'dart' 'rk4'", "semi_implicit_euler"]),
        ({"engine": "installed"}, ["takes `map` in place of `integrator`", "symplectic_euler"]),
        ({"map": "rk4"}, ["unknown key in `evaluate`"]),
    ],
)  # fmt: skip
def test_cells_that_no_engine_has_are_refused(entry, fragments):
    evaluate = [*_small()["evaluate"], {"integrator": "rk4", "dt": 0.05, **entry}]
    with pytest.raises(SpecError) as caught:
        parse_spec(_small(evaluate=evaluate), "panel.toml")
    for fragment in fragments:
        assert fragment in str(caught.value)
    assert "\n" not in str(caught.value)


def test_unknown_maps_are_refused():
    evaluate = [*_small()["evaluate"], {"engine": "installed", "map": "rk5", "dt": 0.05}]
    with pytest.raises(SpecError, match="unknown map in `evaluate`"):
        parse_spec(_small(evaluate=evaluate), "panel.toml")


ON_MUJOCO = {"engine": "mujoco", "integrator": "Euler", "dt": 0.05}


def _trained_on_mujoco(**changes):
    data = _small(train=[ON_MUJOCO], family=[], seeds=[0], **changes)
    return {**data, "evaluate": [*data["evaluate"], ON_MUJOCO]}


def test_the_fleet_refuses_an_engine_that_is_not_made_of_jax():
    needs("mujoco")
    with pytest.raises(SpecError, match="made of JAX's operations; use --trainer sb3"):
        check_spec(parse_spec(_trained_on_mujoco(trainer="fleet"), "panel.toml"))


def test_policies_are_trained_on_an_engine_and_its_version_is_held(tmp_path, capsys):
    """With stable-baselines3; results of another version of the engine are refused."""
    needs("mujoco")
    toml = (
        small_panel.TOML.replace(
            '[[train]]\nintegrator = ["explicit_euler", "rk4"]',
            '[[train]]\nengine = "mujoco"\nintegrator = "Euler"',
        )
        .replace("seeds = [0, 1]", "seeds = [0]")
        .replace("total_steps = 2048", "total_steps = 1024")
    )
    toml = toml.replace('compare = [["rk4 dt=0.05", "explicit_euler dt=0.05"]]', "")
    toml = toml.replace('[["rk4 dt=0.05", "reference', '[["mujoco Euler dt=0.05", "reference')
    toml += '\n[[evaluate]]\nengine = "mujoco"\nintegrator = ["Euler", "RK4"]\ndt = [0.05, 0.025]\n'
    spec, out = tmp_path / "mujoco.toml", tmp_path / "out"
    spec.write_text(toml, encoding="utf-8")
    command = ["panel", str(spec), "--out", str(out), "--no-progress"]
    assert main(command) == 0
    card = json.loads(next(out.glob("policies/*/policy.json")).read_text())
    assert card["config"]["env_arguments"]["engine"] == "mujoco"
    found = (
        EvidenceStore(out / "evidence")
        .query("SELECT DISTINCT engine, integrator, phase FROM records WHERE engine = 'mujoco'")
        .to_pylist()
    )
    assert {(one["integrator"], one["phase"]) for one in found} == {
        ("Euler", "training"), ("Euler", "evaluation"), ("RK4", "evaluation"),
    }  # fmt: skip
    manifest = json.loads((out / "run.json").read_text())
    manifest["versions"]["mujoco"] = "3.0.0"
    (out / "run.json").write_text(json.dumps(manifest))
    capsys.readouterr()
    assert main(command) == 2
    assert "holds results of mujoco 3.0.0 (now" in capsys.readouterr().err


def test_keys_of_units_hold_the_versions_of_engines_that_are_used(monkeypatch):
    needs("mujoco")
    foreign, ours = (parse_spec(d, "test") for d in (_trained_on_mujoco(), _small()))
    keys = []
    for version in ("1", "2"):
        monkeypatch.setattr(units, "engine_versions", lambda names, v=version: dict.fromkeys(
            set(names) - {"native"}, v))  # fmt: skip
        keys.append([_key(spec) for spec in (foreign, ours)])
    assert keys[0][0] != keys[1][0]
    assert keys[0][1] == keys[1][1]
    assert foreign.engine_versions() == {"mujoco": package_version("mujoco")}
    assert ours.engine_versions() == {}


def _key(spec):
    return training_key(training_config(spec, _trained(spec)[0]))


def test_a_cell_of_an_engine_is_expected_to_take_longer():
    """In proportion to its steps, for its lanes are advanced one by one."""
    needs("mujoco")
    spec = parse_spec(_trained_on_mujoco(ladder=False), "test")
    seconds = {cell.name: cell_seconds(spec, cell) for cell in spec.cells_of(spec.train[0])}
    assert seconds["rk4 dt=0.05"] == seconds["rk4 dt=0.0125"]
    assert seconds["mujoco Euler dt=0.05"] > 2.0 * seconds["rk4 dt=0.05"]


def test_every_engine_but_casadi_has_symplectic_euler():
    maps = ("symplectic_euler", "symplectic_euler_implicit_damping")
    without = {name for name in FOREIGN if integrator_applying(name, maps) is None}
    assert without == {"casadi"}
