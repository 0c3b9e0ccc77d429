"""Records of episodes that an engine other than ours advanced."""

from __future__ import annotations

import json

import gymnasium as gym
import numpy as np
import pytest
from engine_cases import FIRST, STOPPED, TOLERANCE, needs

import integ_gym
from integ_gym.envs.engines import ENGINES
from integ_gym.evidence import EpisodeContext, EvidenceStore, RecordEvidence


def _record(folder, engine, integrator, **arguments):
    """One recorded episode of a cart that coasts into its stop."""
    needs(engine)
    env = gym.make(
        "IntegCartPoleSwingUp-v0", engine=engine, integrator=integrator, dt=0.01, duration=0.5,
        **arguments,
    )  # fmt: skip
    recorder = RecordEvidence(env, folder, EpisodeContext("run", "cell"))
    recorder.reset(seed=0, options={"state": (2.2, 2.0, 3.0, 0.0)})
    ended = False
    while not ended:
        *_, terminated, truncated, _ = recorder.step(np.zeros(1, np.float32))
        ended = terminated or truncated
    recorder.close()
    store = EvidenceStore(folder)
    assert store.verify() == []
    (record,) = store.records()
    return {**record.summary(), **record.trace, "json": record.to_json()}


@pytest.mark.parametrize(("engine", "integrator"), FIRST)
def test_a_record_says_what_the_engine_really_is(engine, integrator, tmp_path):
    record = _record(tmp_path, engine, integrator)
    own = ENGINES.load(engine)
    told = json.loads(record["engine_description"])
    assert (record["engine"], record["integrator"]) == (engine, integrator)
    assert record["float_width"] == told["width"] == own.width
    assert told["map"] in told["fingerprint"]["equal_maps"]
    assert max(told["fingerprint"]["defects"].values()) <= TOLERANCE[own.width]
    assert told["fingerprint"]["version"] == record["engine_version"]
    assert record["solver_status"] == ("ok" if own.reports else "not_reported")
    assert np.isfinite(record["energy_residual"]).all()


@pytest.mark.parametrize(("engine", "integrator"), STOPPED)
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
