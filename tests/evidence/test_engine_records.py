"""Records of episodes that an engine other than ours advanced."""

from __future__ import annotations

import json

import gymnasium as gym
import numpy as np
import pytest
from engine_cases import FIRST, STOPPED, TOLERANCE, lighter, needs
from recording import CONTEXT, made, run_out

import integ_gym
from integ_gym.envs.registries import ENGINES
from integ_gym.evidence.recorder import RecordEvidence
from integ_gym.evidence.store import EvidenceStore

INTO_THE_STOP = (2.2, 2.0, 3.0, 0.0)


def _record(folder, engine, integrator, **arguments):
    """One recorded episode of a cart that coasts into its stop."""
    needs(engine)
    told = {"engine": engine, "integrator": integrator, "dt": 0.01, **arguments}
    env = made(folder, CONTEXT, "IntegCartPoleSwingUp-v0", **told)
    env.reset(seed=0, options={"state": INTO_THE_STOP})
    run_out(env, np.zeros(1, np.float32))
    env.close()
    store = EvidenceStore(folder)
    assert store.verify() == []
    (record,) = store.records()
    reports = env.unwrapped.setup.engine.reports
    return {**record.summary(), **record.trace, "json": record.to_json(), "reports": reports}


@pytest.mark.parametrize(("engine", "integrator"), lighter(FIRST))
def test_a_contact_is_logged_with_what_the_engine_really_is(engine, integrator, tmp_path):
    """Depth of the stop, the energy that it holds and takes, and no constraint violation."""
    record = _record(tmp_path, engine, integrator, dt=0.002, control_period=0.01)
    own = ENGINES.load(engine)
    told = json.loads(record["engine_description"])
    assert (record["engine"], record["integrator"]) == (engine, integrator)
    assert record["float_width"] == told["width"] == own.width
    assert told["map"] in told["fingerprint"]["equal_maps"]
    assert max(told["fingerprint"]["defects"].values()) <= TOLERANCE[own.width]
    assert told["fingerprint"]["version"] == record["engine_version"]
    assert record["solver_status"] == ("ok" if record["reports"] else "not_reported")
    assert np.isfinite(record["energy_residual"]).all()
    assert record["penetration_max"] == record["penetration"].max()
    assert record["penetration_max"] == pytest.approx(0.036, abs=0.004)
    deepest = record["penetration"].argmax()
    assert record["contact_force"][deepest] < -60.0
    energy, loss = record["energy"], record["contact_loss"]
    assert energy[0] - energy[-1] == pytest.approx(loss[1:].sum(), abs=0.1)
    assert record["contact_loss_total"] == pytest.approx(1.2, abs=0.2)
    assert told["constraint_violation"] == "not applicable: generalized coordinates"
    assert record["constraint_violation_max"] is None
    assert "constraint_violation" not in record


@pytest.mark.parametrize(("engine", "integrator"), lighter(list(dict(reversed(STOPPED)).items())))
def test_a_ledger_that_the_engines_stops_leave_open_is_null(engine, integrator, tmp_path):
    record = _record(tmp_path, engine, integrator, contact="engine")
    assert json.loads(record["engine_description"])["stops"]
    assert record["energy_residual_total"] is None
    assert record["contact_loss_total"] is None
    touched = record["contact_force"] != 0.0
    np.testing.assert_array_equal(np.isnan(record["energy_residual"]), touched)
    assert touched.any()
    assert not touched.all()
    assert json.loads(record.pop("json"))["energy_residual"].count(None) == touched.sum() + 1


def test_a_loss_that_is_not_known_is_null(tmp_path):
    """Of a MuJoCo task with joint damping, under RK4."""
    needs("mujoco")
    task = integ_gym.rediscretize(gym.make("InvertedPendulum-v5"), integrator="RK4")
    recorder = RecordEvidence(task, tmp_path, CONTEXT)
    recorder.reset(seed=0)
    run_out(recorder, np.ones(1, np.float32))
    recorder.close()
    store = EvidenceStore(tmp_path)
    assert store.verify() == []
    (record,) = store.records()
    assert record["dissipated_total"] is None
    assert record["energy_residual_total"] is None
    assert np.isnan(record["dissipated"]).all()
