"""Any Gymnasium environment is recorded; what it does not tell is null, and said to be unknown."""

import json

import gymnasium as gym
import jsonschema
import numpy as np
import pytest
from engine_cases import FIRST, STOPPED, TOLERANCE, lighter, needs
from gymnasium import spaces
from recording import CONTEXT, made, run_out

import integ_gym
from integ_gym.envs.registries import ENGINES
from integ_gym.evidence.labels import EpisodeContext
from integ_gym.evidence.recomputing import recompute
from integ_gym.evidence.recorder import GenericEnv, RecordEvidence
from integ_gym.evidence.replaying import replay
from integ_gym.evidence.schema import json_schema
from integ_gym.evidence.store import EvidenceStore

UNKNOWN = (
    *("engine", "engine_version", "integrator", "dt", "control_period", "substeps", "duration"),
    *("sensor_period", "action_latency", "observation_noise", "fallback", "start", "success"),
    *("energy_start", "energy_end", "work_total", "dissipated_total", "energy_residual_total"),
    *("saturated_share", "fallback_count", "recovery_count", "solver_iterations_max"),
    *("latency_budget", "float_width", "time_to_success"),
)

STOCK = ("CartPole-v1", "Taxi-v4", "Blackjack-v1")


class Odd(gym.Env):
    """An environment with spaces and arguments of all kinds."""

    observation_space = spaces.Dict(
        {"image": spaces.Box(0, 255, (2, 2, 3), np.uint8), "mode": spaces.Discrete(3)}
    )
    action_space = spaces.Tuple((spaces.MultiDiscrete([2, 3]), spaces.Box(-1.0, 1.0, (2,))))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self._left = 5
        return self.observation_space.sample(), {}

    def step(self, action):
        self._left -= 1
        return self.observation_space.sample(), 0.5, self._left == 0, False, {"energy": "none"}


class Image(Odd):
    observation_space = spaces.Box(0, 255, (64, 64, 3), np.uint8)


def _record(env, tmp_path):
    env = RecordEvidence(env, tmp_path, EpisodeContext("run", "cell"))
    for seed in range(2):
        env.reset(seed=seed)
        run_out(env)
    env.close()
    records = list(EvidenceStore(tmp_path).records())
    totals = [record["reward"].sum() for record in records]
    assert [record["return"] for record in records] == pytest.approx(totals)
    return records


def _check(records, tmp_path, *wrappers):
    for record in records:
        assert {name for name in UNKNOWN if record[name] is not None} == set()
        said = json.loads(record["engine_description"])
        assert said["known"] is False
        assert said["wrappers"][: len(wrappers)] == list(wrappers)
        assert record["failure_label"] == "unattributed"
        assert "not known" in record.reason
        jsonschema.validate(json.loads(record.to_json()), json_schema())
        assert list(recompute(record, "file")) == []
    store = EvidenceStore(tmp_path)
    assert store.verify() == []
    assert replay(list(store.named_records())).records == 0


@pytest.mark.parametrize("env_id", STOCK)
def test_what_is_not_known_is_null(env_id, tmp_path):
    records = _record(gym.make(env_id), tmp_path)
    _check(records, tmp_path)
    assert [record["env_id"] for record in records] == [env_id] * 2
    assert [record["seed"] for record in records] == [0, 1]
    assert records[0]["length"] == len(records[0]["reward"])


def test_a_mujoco_task_as_it_is(tmp_path):
    needs("mujoco")
    records = _record(gym.make("Hopper-v5"), tmp_path)
    _check(records, tmp_path)
    assert {f"action{k}_commanded" for k in range(3)} <= set(records[0].trace)
    assert records[0]["sensed_obs10"].shape == (records[0]["length"] + 1,)


def test_wrappers_are_listed_and_their_view_is_recorded(tmp_path):
    env = gym.wrappers.TransformReward(gym.make("CartPole-v1"), lambda reward: 2.0 * reward)
    env = gym.wrappers.FlattenObservation(env)
    records = _record(env, tmp_path)
    _check(records, tmp_path, "FlattenObservation", "TransformReward", "TimeLimit")
    assert (records[0]["reward"] == 2.0).all()


def test_odd_spaces_are_recorded_and_what_is_too_large_for_a_trace_is_left_out_and_said(tmp_path):
    for kind, columns, left_out in ((Odd, 15, []), (Image, 0, ["observation (12288 numbers)"])):
        records = _record(kind(), tmp_path / kind.__name__)
        _check(records, tmp_path / kind.__name__)
        assert records[0]["env_id"] == kind.__name__
        assert sum(name.startswith("sensed_") for name in records[0].trace) == columns
        said = json.loads(records[0]["engine_description"])
        assert said.get("left_out", []) == left_out


def test_the_limit_of_a_class_made_directly_is_read_from_its_wrapper():
    env = gym.wrappers.TimeLimit(gym.envs.classic_control.CartPoleEnv(), 12)
    assert GenericEnv(env).setup.timing.horizon == 12


INTO_THE_STOP = (2.2, 2.0, 3.0, 0.0)


def _into_the_stop(folder, engine, integrator, **arguments):
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
    record = _into_the_stop(tmp_path, engine, integrator, dt=0.002, control_period=0.01)
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
    record = _into_the_stop(tmp_path, engine, integrator, contact="engine")
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
