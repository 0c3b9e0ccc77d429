"""Policies trained on an engine: by whom, and under which version."""

from __future__ import annotations

import json

from engine_cases import needs
from engines_panel import trained_units
from small_panel import small_data

from integ_gym.cli import main
from integ_gym.eval.panel import units
from integ_gym.eval.panel.spec import parse_spec
from integ_gym.eval.panel.units import training_config, training_key
from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.optional import package_version

ON_MUJOCO = {"engine": "mujoco", "integrator": "Euler", "dt": 0.05}

TOML = """
name = "mujoco"
env_id = "IntegPendulum-v0"
control_period = 0.05
seeds = [0]
episodes = 2
trainer = "sb3"
baselines = ["zero"]
perturbations = []
ladder = false
family = [["mujoco Euler dt=0.05", "reference dt=0.05"]]

[environment]
start = "hanging"
max_torque = 1.0
duration = 2.0

[training]
total_steps = 256
n_envs = 4
n_steps = 32
batch_size = 64
n_epochs = 1

[[train]]
engine = "mujoco"
integrator = "Euler"
dt = 0.05

[[evaluate]]
engine = "mujoco"
integrator = ["Euler", "RK4"]
dt = 0.05
"""


def _trained_on_mujoco(**changes):
    data = small_data(compare=[], train=[ON_MUJOCO], family=[], seeds=[0], **changes)
    return {**data, "evaluate": [*data["evaluate"], ON_MUJOCO]}


def test_policies_are_trained_on_an_engine_and_its_version_is_held(tmp_path, capsys):
    """With stable-baselines3; results of another version of the engine are refused."""
    needs("mujoco")
    spec, out = tmp_path / "mujoco.toml", tmp_path / "out"
    spec.write_text(TOML, encoding="utf-8")
    command = ["panel", str(spec), "--out", str(out), "--workers", "1", "--no-progress"]
    assert main(command) == 0
    card = json.loads(next(out.glob("policies/*/policy.json")).read_text())
    assert card["config"]["env_arguments"]["engine"] == "mujoco"
    found = (
        EvidenceStore(out / "evidence")
        .query(
            "SELECT DISTINCT engine, integrator, phase FROM records "
            "WHERE engine = 'mujoco' AND phase IN ('training', 'evaluation')"
        )
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
    foreign, ours = (parse_spec(d, "test") for d in (_trained_on_mujoco(), small_data(compare=[])))
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
