"""Any Gymnasium environment is recorded; what it does not tell is null, and said to be unknown."""

from __future__ import annotations

import json

import gymnasium as gym
import jsonschema
import numpy as np
import pytest
from engine_cases import needs
from gymnasium import spaces
from recording import run_out

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
    for made, columns, left_out in ((Odd, 15, []), (Image, 0, ["observation (12288 numbers)"])):
        records = _record(made(), tmp_path / made.__name__)
        _check(records, tmp_path / made.__name__)
        assert records[0]["env_id"] == made.__name__
        assert sum(name.startswith("sensed_") for name in records[0].trace) == columns
        said = json.loads(records[0]["engine_description"])
        assert said.get("left_out", []) == left_out


def test_the_limit_of_a_class_made_directly_is_read_from_its_wrapper():
    env = gym.wrappers.TimeLimit(gym.envs.classic_control.CartPoleEnv(), 12)
    assert GenericEnv(env).setup.timing.horizon == 12
