"""Records of episodes that an engine other than ours advanced."""

from __future__ import annotations

import json

import gymnasium as gym
import numpy as np
import pytest
from engine_cases import EVERY, FIRST, STOPPED, TOLERANCE, lighter, needs

import integ_gym
from integ_gym.envs.registries import ENGINES
from integ_gym.evidence.labels import EpisodeContext
from integ_gym.evidence.recorder import RecordEvidence
from integ_gym.evidence.store import EvidenceStore

INTO_THE_STOP = (2.2, 2.0, 3.0, 0.0)
FREELY = (0.0, 0.1, 2.0, 0.0)


def _record(folder, engine, integrator, state=INTO_THE_STOP, **arguments):
    """One recorded episode of a cart that coasts, into its stop or freely."""
    needs(engine)
    env = gym.make(
        "IntegCartPoleSwingUp-v0", engine=engine, integrator=integrator,
        **{"dt": 0.01, "duration": 0.5, **arguments},
    )  # fmt: skip
    recorder = RecordEvidence(env, folder, EpisodeContext("run", "cell"))
    recorder.reset(seed=0, options={"state": state})
    ended = False
    while not ended:
        *_, terminated, truncated, _ = recorder.step(np.zeros(1, np.float32))
        ended = terminated or truncated
    recorder.close()
    store = EvidenceStore(folder)
    assert store.verify() == []
    (record,) = store.records()
    reports = env.unwrapped.setup.engine.reports
    return {**record.summary(), **record.trace, "json": record.to_json(), "reports": reports}


@pytest.mark.parametrize(("engine", "integrator"), lighter(EVERY))
def test_a_record_says_what_the_engine_really_is(engine, integrator, tmp_path):
    record = _record(tmp_path, engine, integrator)
    own = ENGINES.load(engine)
    told = json.loads(record["engine_description"])
    assert (record["engine"], record["integrator"]) == (engine, integrator)
    assert record["float_width"] == told["width"] == own.width
    assert told["map"] in told["fingerprint"]["equal_maps"]
    assert max(told["fingerprint"]["defects"].values()) <= TOLERANCE[own.width]
    assert told["fingerprint"]["version"] == record["engine_version"]
    assert record["solver_status"] == ("ok" if record["reports"] else "not_reported")
    assert np.isfinite(record["energy_residual"]).all()


@pytest.mark.parametrize(("engine", "integrator"), lighter(FIRST))
def test_a_free_motion_is_logged(engine, integrator, tmp_path):
    """Energy that hardly changes, no penetration, and why there is no constraint violation."""
    record = _record(tmp_path, engine, integrator, FREELY, dt=0.002, control_period=0.01)
    assert len(record["energy"]) == 51
    change = record["energy"] / record["energy"][0] - 1.0
    assert 0.0 < np.abs(change).max() < 0.01
    assert (record["penetration"] == 0.0).all()
    assert record["penetration_max"] == 0.0
    _has_no_constraint(record)


@pytest.mark.parametrize(("engine", "integrator"), lighter(FIRST))
def test_a_contact_is_logged(engine, integrator, tmp_path):
    """Depth of the stop, the energy that it holds and takes, and no constraint violation."""
    record = _record(tmp_path, engine, integrator, dt=0.002, control_period=0.01)
    assert record["penetration_max"] == record["penetration"].max()
    assert record["penetration_max"] == pytest.approx(0.036, abs=0.004)
    deepest = record["penetration"].argmax()
    assert record["contact_force"][deepest] < -60.0
    energy, loss = record["energy"], record["contact_loss"]
    assert energy[0] - energy[-1] == pytest.approx(loss[1:].sum(), abs=0.1)
    assert record["contact_loss_total"] == pytest.approx(1.2, abs=0.2)
    _has_no_constraint(record)


def _has_no_constraint(record):
    told = json.loads(record["engine_description"])
    assert told["constraint_violation"] == "not applicable: generalized coordinates"
    assert record["constraint_violation_max"] is None
    assert "constraint_violation" not in record


@pytest.mark.parametrize(("engine", "integrator"), lighter(STOPPED))
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
    recorder = RecordEvidence(task, tmp_path, EpisodeContext("run", "cell"))
    recorder.reset(seed=0)
    ended = False
    while not ended:
        *_, terminated, truncated, _ = recorder.step(np.ones(1, np.float32))
        ended = terminated or truncated
    recorder.close()
    store = EvidenceStore(tmp_path)
    assert store.verify() == []
    (record,) = store.records()
    assert record["dissipated_total"] is None
    assert record["energy_residual_total"] is None
    assert np.isnan(record["dissipated"]).all()
