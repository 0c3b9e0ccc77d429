"""Recording a single environment."""

from __future__ import annotations

import json
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from integ_gym.envs.catalogue.pendulum import IntegPendulumEnv
from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.evidence import recorder as recorder_module
from integ_gym.evidence.fields import PHASES, record_fields
from integ_gym.evidence.labels import EpisodeContext, Replays
from integ_gym.evidence.recorder import RecordEvidence
from integ_gym.evidence.schema import BatchExistsError, EvidenceError
from integ_gym.evidence.store import EvidenceStore
from integ_gym.evidence.vector_recorder import RecordVectorEvidence

SETTINGS = {
    "plain": {},
    "implicit": {"integrator": "implicit_midpoint"},
    "substeps": {"integrator": "rk4", "dt": 0.01, "control_period": 0.05},
    "late": {
        "dt": 0.01,
        "control_period": 0.02,
        "action_latency": 0.03,
        "sensor_period": 0.05,
        "observation_noise": 0.01,
    },
}


@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_records_are_what_stepping_gave(env_id, settings, tmp_path, context, play):
    env = RecordEvidence(gym.make(env_id, duration=1.0, **settings), tmp_path, context)
    setup = env.unwrapped.setup
    played = play(env, range(3))
    env.close()
    records = list(EvidenceStore(tmp_path).records())
    assert len(records) == 3
    control = setup.plant.control_name
    names = [f"sensed_{name}" for name in setup.task.observation_names]
    states = [name for pair in zip(setup.plant.coordinates, setup.plant.velocities, strict=True)
              for name in pair]  # fmt: skip
    for k, ((instants, steps), record) in enumerate(zip(played, records, strict=True)):
        observed, energy, sensed, state = map(np.array, zip(*instants, strict=True))
        rewards = np.array([reward for reward, _ in steps])
        infos = {name: np.array([info[name] for _, info in steps]) for name in steps[0][1]}
        expected = {
            "time": np.array([0.0, *infos["time"]]),
            "energy": energy,
            "sensor_time": sensed,
            "reward": rewards,
            "work": infos["actuator_work"],
            "dissipated": infos["dissipated"],
            "clip_loss": infos["clip_loss"],
            **{name: infos[name] for name in ("penetration", "contact_force", "contact_loss")},
            "energy_residual": infos["energy_residual"],
            "solver_iterations": infos["solver_iterations"],
            f"{control}_commanded": infos["commanded"],
            f"{control}_applied": infos["control"],
            **dict(zip(states, state.T, strict=True)),
            **dict(zip(names, observed.T, strict=True)),
        }
        for name, values in expected.items():
            np.testing.assert_array_equal(record.trace[name], values, err_msg=name)
        assert observed.dtype == record.trace[names[0]].dtype == np.float32
        last = steps[-1][1]
        assert record["length"] == len(steps)
        assert record["success"] == last["success"]
        assert record["return"] == pytest.approx(rewards.sum(), rel=1e-12)
        assert record["initial_state"] == state[0].tolist()
        assert record["solver_iterations_max"] == infos["solver_iterations"].max()
        assert record["energy_end"] - record["energy_start"] == pytest.approx(
            record["work_total"]
            - record["dissipated_total"]
            - record["contact_loss_total"]
            - record["clip_loss_total"]
            + record["energy_residual_total"],
            abs=1e-9,
        )
        assert (record["seed"], record["rng_key"], record["episode_index"]) == (k, f"{k}/0", k)
        assert record["wall_start"] <= record["wall_end"]
        assert record["penetration_max"] == infos["penetration"].max()
        assert record["constraint_violation_max"] is None
        assert "constraint_violation" not in record.trace


def test_discretization_and_arguments(tmp_path, context, play):
    arguments = SETTINGS["late"] | {"mass": 1.25, "integrator": "implicit_euler", "duration": 0.2}
    env = RecordEvidence(gym.make("IntegPendulum-v0", **arguments), tmp_path, context)
    play(env, [0])
    env.close()
    (record,) = EvidenceStore(tmp_path).records()
    for name, value in arguments.items():
        assert record.arguments()[name] == value
        if name not in ("mass", "integrator"):
            assert record[name] == pytest.approx(value, rel=1e-12)
    assert record["integrator"] == "implicit_euler"
    assert json.loads(record["arguments"])["mass"] == {"value": 1.25, "unit": "kg"}
    assert record["substeps"] == 2
    assert record["latency_budget"] == 0.02
    assert record["engine"] == "native"
    assert record["solver_tolerance"] > 0.0
    assert record["solver_cap"] >= 1
    assert json.loads(record["package_versions"])["gymnasium"] == gym.__version__


def test_context_is_recorded(tmp_path, play):
    context = EpisodeContext(
        "run", "cell", policy_id="ppo", policy_hash="abc", training_seed=3,
        training_discretization={"integrator": "rk4", "dt": 0.05}, perturbation={"mass": 1.2},
        first_episode=40, inference_latency_mean=900.0, inference_latency_p99=1500.0,
        replays=Replays(home=True), packages={"torch": "2.13.0"},
    )  # fmt: skip
    env = RecordEvidence(gym.make("IntegPendulum-v0", duration=0.5), tmp_path, context)
    play(env, range(2))
    env.close()
    first, second = EvidenceStore(tmp_path).records()
    assert [first["episode_index"], second["episode_index"]] == [40, 41]
    assert first["record_id"] == context.record_id(40) != second["record_id"]
    assert json.loads(first["training_discretization"]) == {"integrator": "rk4", "dt": 0.05}
    assert json.loads(first["perturbation"]) == {"mass": 1.2}
    assert json.loads(first["package_versions"])["torch"] == "2.13.0"
    assert first["inference_latency_mean"] == 900.0
    assert first["failure_label"] == "discretization_error"


@pytest.mark.parametrize(
    ("home", "label"),
    [
        ({"integrator": "symplectic_euler", "dt": 0.05}, "planning_error"),
        ([{"integrator": "rk4"}, {"integrator": "symplectic_euler"}], "planning_error"),
        ({"integrator": "rk4", "dt": 0.05}, "unattributed"),
        (None, "planning_error"),
    ],
)
def test_home_needs_no_replay(home, label, tmp_path, play):
    context = EpisodeContext("run", "cell", training_discretization=home)
    env = gym.make("IntegPendulum-v0", duration=0.5)
    env = RecordEvidence(env, tmp_path, context)
    env.reset(seed=0, options={"state": (np.pi, 0.0)})
    while not env.step(np.zeros(1, dtype=np.float32))[3]:
        pass
    env.close()
    (record,) = EvidenceStore(tmp_path).records()
    assert record["failure_label"] == label


def test_what_a_label_rests_on_is_recorded(tmp_path, play):
    """By episode: whether the policy's replays succeeded, and what was known beside them."""
    context = EpisodeContext("run", "cell", training_discretization={"integrator": "rk4"})
    env = RecordEvidence(gym.make("IntegPendulum-v0", duration=0.5), tmp_path, context)
    play(env, range(6))
    said = {
        0: Replays(home=True, cell_status="unachievable", home_success=0.25, second_horizon=True),
        1: Replays(home=True, cell_status="too_slow", home_success=0.25, second_horizon=True),
        2: Replays(home=True, cell_status="achievable", home_success=0.75, second_horizon=True),
        3: Replays(home=True, without_noise=False, without_delay=True, second_horizon=False),
        4: Replays(home="is home", cell_status="undecided", home_success=1.0),
    }
    env.commit(replays=said)
    env.close()
    records = list(EvidenceStore(tmp_path).records())
    names = (*Replays().columns(), "failure_label")
    assert [tuple(record[name] for name in names) for record in records] == [
        (True, None, None, True, 0.25, "unachievable", "unachievable"),
        (True, None, None, True, 0.25, "too_slow", "not_learned"),
        (True, None, None, True, 0.75, "achievable", "too_slow"),
        (True, False, True, False, None, None, "discretization_error"),
        (None, None, None, None, 1.0, "undecided", records[4]["failure_label"]),
        (None, None, None, None, None, None, "unattributed"),
    ]
    assert records[4]["failure_label"] in ("control_error", "planning_error")
    assert EvidenceStore(tmp_path).verify() == []


def test_divergence_is_an_evaluation_error(tmp_path, context):
    env = gym.make("IntegCartPole-v0", integrator="explicit_euler", dt=1.0, force_mag=1e4)
    env = RecordEvidence(env, tmp_path, context)
    env.reset(seed=0)
    while not any(env.step(1)[2:4]):
        pass
    env.close()
    (record,) = EvidenceStore(tmp_path).records()
    assert record["solver_status"] == "diverged"
    assert record["failure_label"] == "evaluation_error"
    assert record["solver_status_code"][-1] == 2


def test_saturation_fallback_and_recovery(tmp_path, context):
    env = RecordEvidence(gym.make("IntegPendulum-v0", duration=0.5), tmp_path, context)
    env.reset(seed=0)
    for action in (np.nan, np.nan, 9.0, 9.0, 9.0, np.nan, 9.0, 0.0, 0.0, np.nan):
        env.step(np.array([action], dtype=np.float32))
    env.close()
    (record,) = EvidenceStore(tmp_path).records()
    assert record["fallback_count"] == 4
    assert record["recovery_count"] == 2
    assert record["saturated_share"] == pytest.approx(0.4)


class _Constrained(IntegPendulumEnv):
    """A pendulum that reports a violated constraint."""

    def reset(self, **arguments):
        observation, info = super().reset(**arguments)
        return observation, info | {"constraint_violation": 0.0}

    def step(self, action):
        *result, info = super().step(action)
        return *result, info | {"constraint_violation": abs(self.state[1])}


def test_constraint_violation_is_recorded_where_there_is_any(tmp_path, context, play):
    env = RecordEvidence(_Constrained(duration=0.5), tmp_path, context)
    play(env, [0])
    env.close()
    (record,) = EvidenceStore(tmp_path).records()
    assert record["env_id"] == "_Constrained"
    np.testing.assert_array_equal(record["constraint_violation"], abs(record["theta_dot"][1:]))
    assert record["constraint_violation_max"] == record["constraint_violation"].max()


STOPPED = {
    "IntegPendulum-v0": ({"joint_limit": 1.0, "start": "uniform"}, "rad", "N m"),
    "IntegCartPoleSwingUp-v0": ({"track_limit": 0.02}, "m", "N"),
}


@pytest.mark.parametrize("env_id", STOPPED)
def test_contact_is_recorded(env_id, tmp_path, context, play):
    arguments, unit, force_unit = STOPPED[env_id]
    env = RecordEvidence(
        gym.make(env_id, duration=1.0, integrator="rk4", dt=0.01, **arguments), tmp_path, context
    )
    ((_, steps),) = play(env, [0])
    env.close()
    store = EvidenceStore(tmp_path)
    (record,) = store.records()
    assert record["penetration_max"] > 0.0
    assert np.abs(record["contact_force"]).max() > 0.0
    assert record["contact_loss_total"] > 0.0
    assert record["contact_loss_total"] == pytest.approx(sum(i["contact_loss"] for _, i in steps))
    task = env.unwrapped.setup.task
    units = {field.name: field.unit for field in record_fields(env.unwrapped.setup.plant, task)}
    assert units["penetration"] == units["penetration_max"] == unit
    assert units["contact_force"] == force_unit


def test_unfinished_episodes_are_not_written(tmp_path, context):
    env = RecordEvidence(gym.make("IntegPendulum-v0", duration=0.5), tmp_path, context)
    action = np.zeros(1, dtype=np.float32)
    env.reset(seed=0)
    for _ in range(4):
        env.step(action)
    env.reset(seed=1)
    for _ in range(10):
        env.step(action)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        env.step(action)
    env.reset()
    env.step(action)
    env.close()
    (record,) = EvidenceStore(tmp_path).records()
    assert (record["seed"], record["episode_index"], record["length"]) == (1, 0, 10)


def test_keys_count_the_episodes_since_seeding(tmp_path, context, play):
    env = RecordEvidence(gym.make("IntegPendulum-v0", duration=0.5), tmp_path, context)
    play(env, [None, None, 5, None, 2**70])
    entropy = [env.unwrapped.np_random_seed]
    env.close()
    records = list(EvidenceStore(tmp_path).records())
    assert [record["seed"] for record in records] == [None, None, 5, 5, None]
    keys = [record["rng_key"].split("/") for record in records]
    assert [int(draws) for _, draws in keys] == [0, 1, 0, 1, 0]
    assert keys[0][0] == keys[1][0] != keys[2][0] == keys[3][0] == "5"
    assert entropy == [int(keys[4][0])] == [2**70]
    again = gym.make("IntegPendulum-v0", duration=0.5)
    again.reset(seed=int(keys[0][0]))
    assert again.unwrapped.state.tolist() == records[0]["initial_state"]


@pytest.mark.parametrize("phase", PHASES)
def test_traces_every_nth(phase, tmp_path, play):
    context = EpisodeContext("run", "cell", phase=phase, trace_every=3)
    env = RecordEvidence(gym.make("IntegPendulum-v0", duration=0.5), tmp_path, context)
    play(env, range(7))
    env.close()
    records = list(EvidenceStore(tmp_path).records())
    assert [bool(record.trace) for record in records] == [k % 3 == 0 for k in range(7)]
    assert all(record["length"] == 10 for record in records)
    assert all(record["trace_every"] == 3 for record in records)
    assert EvidenceStore(tmp_path).verify() == []


def test_many_episodes_pass_through_a_small_buffer(tmp_path, context, play, monkeypatch):
    env_arguments = {"duration": 0.9}
    played = {}
    for rows in (1, 4096):
        monkeypatch.setattr(recorder_module, "_FEWEST_ROWS", rows)
        env = gym.make("IntegCartPole-v0", **env_arguments)
        env = RecordEvidence(env, tmp_path / str(rows), context)
        play(env, range(20))
        env.close()
        played[rows] = list(EvidenceStore(tmp_path / str(rows)).records())
    assert len({record["length"] for record in played[1]}) > 3
    for small, large in zip(played[1], played[4096], strict=True):
        assert small["content_hash"] == large["content_hash"]


def test_batches(tmp_path, context, play):
    env = RecordEvidence(gym.make("IntegPendulum-v0", duration=0.5), tmp_path, context)
    assert env.commit() is None
    play(env, [0])
    path = env.commit("mine")
    assert path == tmp_path / "mine.parquet"
    play(env, [1, 2])
    with pytest.raises(BatchExistsError, match="'mine' has already been committed"):
        env.commit("mine")
    env.close()
    store = EvidenceStore(tmp_path)
    assert len(store.batches()) == 2
    assert sorted(record["episode_index"] for record in store.records()) == [0, 1, 2]
    with pytest.raises(EvidenceError, match=r"already; count on with first_episode=3"):
        RecordEvidence(gym.make("IntegPendulum-v0", duration=0.5), tmp_path, context)


def test_records_may_be_taken_and_committed_with_others(tmp_path, context, play):
    env = gym.make("IntegPendulum-v0", duration=0.5)
    env = RecordEvidence(env, tmp_path, context, commit_on_close=False)
    play(env, [0, 1])
    taken = env.take()
    assert taken.num_rows == 2
    assert env.take() is None
    play(env, [2])
    store = EvidenceStore(tmp_path)
    store.commit_all("together", [taken, env.take(), None])
    assert sorted(record["episode_index"] for record in store.records()) == [0, 1, 2]
    assert store.verify() == []


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_environment_stays_what_it_was(env_id, tmp_path, context):
    plain = gym.make(env_id)
    env = RecordEvidence(gym.make(env_id), tmp_path, context)
    assert env.spec == plain.spec
    assert env.observation_space == plain.observation_space
    assert env.action_space == plain.action_space
    assert env.metadata == plain.metadata
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*different from the unwrapped version.*")
        warnings.filterwarnings("ignore", message=".*infinity.*")
        warnings.filterwarnings("ignore", message=".*normalized.*")
        check_env(env, skip_render_check=True)


def test_stepping_before_reset_is_refused_as_before(tmp_path, context):
    env = RecordEvidence(gym.make("IntegPendulum-v0"), tmp_path, context)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(1, dtype=np.float32))


def test_other_environments_are_refused(tmp_path, context):
    with pytest.raises(TypeError, match="integ-gym environments, got SyncVectorEnv"):
        RecordVectorEvidence(gym.make_vec("Pendulum-v1", 2, "sync"), tmp_path, context)
    env = gym.make("IntegPendulum-v0")
    env = gym.wrappers.RescaleAction(env, np.float32(-1.0), np.float32(1.0))
    with pytest.raises(TypeError, match=r"RescaleAction changes.*around the environment first"):
        RecordEvidence(env, tmp_path, context)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"phase": "test"}, "`phase` must be one of training, evaluation, .*got 'test'"),
        ({"trace_every": 0}, "`trace_every` must be 1 or above, got 0"),
        ({"phase": "training", "trace_every": 0}, "`trace_every` must be 1 or above"),
        ({"training_discretization": {"step": 0.1}}, "got {'step': 0.1}"),
        ({"training_discretization": [{}]}, "must have some of engine, integrator"),
    ],
)
def test_impossible_contexts_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        EpisodeContext("run", "cell", **arguments)


def test_a_wrapper_that_changes_rewards_is_refused(tmp_path):
    env = gym.wrappers.TransformReward(gym.make("IntegPendulum-v0"), lambda reward: 2.0 * reward)
    with pytest.raises(TypeError, match="TransformReward changes what would be recorded"):
        RecordEvidence(env, tmp_path, EpisodeContext("run", "cell"))
