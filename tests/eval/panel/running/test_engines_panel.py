"""A panel on several engines: the same policy does the same, and is used again."""

import json
import shutil

import numpy as np
import pytest
import small_panel
from engine_cases import needs, setup_of
from engines_panel import alike_data, trained_units
from known_outcomes import matrix_of
from small_panel import SHORTEST, bare_data

from integ_gym import run_panel
from integ_gym.cli import main
from integ_gym.envs.engines.rigid import HeldForce
from integ_gym.envs.ops.ops import SCALAR, along
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.registries import ENGINES, INTEGRATORS
from integ_gym.envs.settings import Discretization
from integ_gym.eval.panel import units
from integ_gym.eval.panel.cells import Cell
from integ_gym.eval.panel.findings import EVALUATED_ONCE, agreements, twin_of
from integ_gym.eval.panel.matrix import PanelLayout
from integ_gym.eval.panel.result import Policy, Row, read_panel
from integ_gym.eval.panel.run_directory import RunDirectoryError
from integ_gym.eval.panel.spec import parse_spec
from integ_gym.eval.panel.units import training_key
from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.optional import package_version

PRECISE = ("mujoco", "drake", "pinocchio", "dart", "pybullet")
"""Engines with symplectic Euler in float64."""


@pytest.fixture(scope="module")
def alike(made_once):
    """Directory of a finished panel: one trained policy on every installed engine."""
    spec = parse_spec(alike_data(), "test")
    return made_once("alike", lambda folder: run_panel(spec, folder, progress=False))


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
    assert read_panel(alike / "panel.json").answer.startswith(("Yes: on each of", "On "))
    page = (alike / "report.html").read_text(encoding="utf-8")
    for engine in found:
        assert engine in page
        assert panel["versions"][ENGINES.load(engine).package]


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
    assert "from trainer 'sb3' with stable-baselines3 " in message
    assert "this panel's from 'fleet' with jax " in message


ON_MUJOCO = {"engine": "mujoco", "integrator": "Euler", "dt": 0.05}


def test_policies_are_trained_on_an_engine_and_its_version_is_held(tmp_path):
    """With stable-baselines3; results of another version of the engine are refused."""
    needs("mujoco")
    out, both = tmp_path / "out", {**ON_MUJOCO, "integrator": ["Euler", "RK4"]}
    family = [["mujoco Euler dt=0.05", "reference dt=0.05"]]
    data = bare_data(ON_MUJOCO, evaluate=[both], family=family, training=SHORTEST)
    spec = parse_spec(data, "test")
    run_panel(spec, out, workers=1, progress=False)
    card = json.loads(next(out.glob("policies/*/policy.json")).read_text())
    assert card["config"]["env_arguments"]["engine"] == "mujoco"
    found = EvidenceStore(out / "evidence").query(
        "SELECT DISTINCT integrator, phase FROM records "
        "WHERE engine = 'mujoco' AND phase IN ('training', 'evaluation')"
    )
    assert {(one["integrator"], one["phase"]) for one in found.to_pylist()} == {
        ("Euler", "training"), ("Euler", "evaluation"), ("RK4", "evaluation"),
    }  # fmt: skip
    manifest = json.loads((out / "run.json").read_text())
    manifest["versions"]["mujoco"] = "3.0.0"
    (out / "run.json").write_text(json.dumps(manifest))
    with pytest.raises(RunDirectoryError, match=r"holds results of mujoco 3\.0\.0 \(now"):
        run_panel(spec, out, workers=1, progress=False)


def test_keys_of_units_hold_the_versions_of_engines_that_are_used(monkeypatch):
    needs("mujoco")
    places = (ON_MUJOCO, {"integrator": "rk4", "dt": 0.05})
    foreign, ours = (parse_spec(bare_data(place), "test") for place in places)
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
    return training_key(spec, trained_units(spec)[0])


FREE = Pendulum()
NATIVE = {
    cell.name: cell
    for name in INTEGRATORS.names()
    for cell in [Cell.of(Discretization(name, 0.01, 0.05), "grid")]
}


def _twin(engine, integrator, resisted, plant=FREE):
    cell = Cell.of(Discretization(integrator, 0.01, 0.05, engine), "grid")
    found = twin_of(cell, NATIVE, plant, resisted)
    return None if found is None else NATIVE[found].discretization.integrator


@pytest.mark.parametrize(
    ("engine", "integrator", "free", "resisted"),
    [
        ("mujoco", "RK4", "rk4", None),
        ("mujoco", "Euler", "symplectic_euler", "symplectic_euler"),
        ("drake", "radau1", "implicit_euler", None),
        ("drake", "runge_kutta5", None, None),
        ("casadi", "rk", "rk4", "rk4"),
    ],
)
def test_a_cell_whose_stops_act_otherwise_has_no_twin(engine, integrator, free, resisted):
    assert _twin(engine, integrator, False) == free
    assert _twin(engine, integrator, True) == resisted


@pytest.mark.parametrize(
    ("engine", "integrator", "plant", "twin"),
    [
        ("mujoco", "Euler", CartPole(), "symplectic_euler"),
        ("mujoco", "Euler", Pendulum(damping=0.1), None),
        ("mujoco", "implicit", Pendulum(), "symplectic_euler"),
        ("mujoco", "implicit", CartPole(), None),
        ("pybullet", "semi_implicit_euler", Pendulum(damping=0.1), "symplectic_euler"),
        ("sapien", "tgs", CartPole(damping=0.01), None),
    ],
)
def test_forces_of_the_velocity_tell_maps_apart(engine, integrator, plant, twin):
    assert _twin(engine, integrator, False, plant) == twin


@pytest.mark.parametrize(
    ("env_id", "twin"),
    [("IntegCartPole-v0", "rk4 dt=0.05"), ("IntegCartPoleSwingUp-v0", None)],
)
def test_a_panel_looks_whether_its_plant_has_stops(env_id, twin):
    needs("mujoco")
    place = {"integrator": "rk4", "dt": 0.05}
    theirs = {"engine": "mujoco", "integrator": "RK4", "dt": 0.05}
    spec = parse_spec(bare_data(place, theirs, env_id=env_id, environment={}), "test")
    cells = {cell.name: cell for cell in spec.columns()}
    rows = (Row.of("zero", "baseline", [Policy(id="zero")]),)
    layout = PanelLayout(rows, cells, {"zero": tuple(cells)}, None)
    (found,) = agreements(layout, matrix_of(layout, 2, lambda *_: {"success": True}), spec)
    assert found.twin == twin
    assert found.differing == (None if twin is None else 0)


@pytest.mark.parametrize("name", INTEGRATORS.names())
def test_a_force_held_is_the_force_itself_where_it_is_evaluated_once(name):
    setup = setup_of("native", name, "IntegCartPoleSwingUp-v0", dt=0.01)
    q, v = (2.43, 3.0), (0.5, 2.0)
    force = along(
        setup.system.to_generalized_force((1.0,)), 1.0, setup.system.resistance(SCALAR, q, v)[0]
    )
    integrator, held = INTEGRATORS.load(name)(), HeldForce(setup.plant, force)
    mine = integrator.step(SCALAR, setup.system, q, v, (0.0, 0.0), (1.0,), 0.01)
    other = integrator.step(SCALAR, held, q, v, (0.0,), (1.0,), 0.01)
    same = np.allclose((*mine.q, *mine.v), (*other.q, *other.v), rtol=0, atol=1e-12)
    assert same == (name in EVALUATED_ONCE)
