"""Policies trained on an engine: by whom, and under which version."""

from __future__ import annotations

import json

import pytest
from engine_cases import needs
from engines_panel import trained_units
from small_panel import SHORTEST, bare_data

from integ_gym import run_panel
from integ_gym.eval.panel import units
from integ_gym.eval.panel.run_directory import RunDirectoryError
from integ_gym.eval.panel.spec import parse_spec
from integ_gym.eval.panel.units import training_config, training_key
from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.optional import package_version

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
    return training_key(training_config(spec, trained_units(spec)[0]))
