"""A panel on several engines: the same policy does the same, and is used again."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
import small_panel
from engine_cases import needs
from engines_panel import alike_data

from integ_gym import run_panel
from integ_gym.cli import main
from integ_gym.envs.registries import ENGINES
from integ_gym.eval.panel.result import read_panel
from integ_gym.eval.panel.spec import parse_spec
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
