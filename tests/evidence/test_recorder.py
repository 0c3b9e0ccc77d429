"""Recording a single environment."""

import json
import warnings

import gymnasium as gym
import numpy as np
import pyarrow as pa
import pytest
from gymnasium.utils.env_checker import check_env
from pairing import in_turn
from recording import CONTEXT, PENDULUM, made, play, recorded, run_out

from integ_gym.envs.catalogue.pendulum import IntegPendulumEnv
from integ_gym.envs.environment import environment_setup
from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.envs.tasks.interface import to_state_order
from integ_gym.envs.transition import control_columns
from integ_gym.evidence import recorder as recorder_module
from integ_gym.evidence.episodes import EpisodeHeads, EpisodeLog, Layout
from integ_gym.evidence.fields import PHASES
from integ_gym.evidence.labels import EpisodeContext, Replays
from integ_gym.evidence.recorder import RecordEvidence
from integ_gym.evidence.schema import BatchExistsError
from integ_gym.evidence.store import EvidenceStore
from integ_gym.evidence.table import build_unhashed_table

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


@pytest.mark.parametrize(("env_id", "kind"), in_turn(ENVIRONMENTS, SETTINGS))
def test_records_are_what_stepping_gave(env_id, kind, tmp_path):
    env = made(tmp_path, CONTEXT, env_id, **SETTINGS[kind])
    setup = env.unwrapped.setup
    played = play(env, range(2))
    env.close()
    columns = list(zip(setup.plant.controls, control_columns(setup.plant), strict=True))
    names = [f"sensed_{name}" for name in setup.task.observation_names]
    states = [name for pair in zip(setup.plant.coordinates, setup.plant.velocities, strict=True)
              for name in pair]  # fmt: skip
    records = EvidenceStore(tmp_path).records()
    for k, ((instants, steps), record) in enumerate(zip(played, records, strict=True)):
        observed, energy, sensed, state = map(np.array, zip(*instants, strict=True))
        rewards = np.array([reward for reward, _ in steps])
        infos = {name: np.array([info[name] for _, info in steps]) for name in steps[0][1]}
        own = ("dissipated", "clip_loss", "penetration", "contact_force", "contact_loss",
               "energy_residual", "solver_iterations")  # fmt: skip
        expected = {
            "time": np.array([0.0, *infos["time"]]),
            "energy": energy,
            "sensor_time": sensed,
            "reward": rewards,
            "work": infos["actuator_work"],
            **{f"{name}_commanded": infos[asked] for (name, _), (asked, _) in columns},
            **{f"{name}_applied": infos[applied] for (name, _), (_, applied) in columns},
            **{name: infos[name] for name in own},
            **dict(zip(states, to_state_order(setup.task, state).T, strict=True)),
            **dict(zip(names, observed.T, strict=True)),
        }
        for name, values in expected.items():
            np.testing.assert_array_equal(record.trace[name], values, err_msg=name)
        assert observed.dtype == record.trace[names[0]].dtype == np.float32
        assert record["length"] == len(steps)
        assert record["success"] == steps[-1][1]["success"]
        assert record["return"] == pytest.approx(rewards.sum(), rel=1e-12)
        assert record["initial_state"] == to_state_order(setup.task, state)[0].tolist()
        assert record["solver_iterations_max"] == infos["solver_iterations"].max()
        lost = sum(record[f"{name}_total"] for name in ("dissipated", "contact_loss", "clip_loss"))
        change = record["work_total"] - lost + record["energy_residual_total"]
        assert record["energy_end"] - record["energy_start"] == pytest.approx(change, abs=1e-9)
        assert (record["seed"], record["rng_key"], record["episode_index"]) == (k, f"{k}/0", k)
        assert record["wall_start"] <= record["wall_end"]
        assert record["penetration_max"] == infos["penetration"].max()
        assert record["constraint_violation_max"] is None


def test_discretization_arguments_and_context_are_recorded(tmp_path):
    arguments = SETTINGS["late"] | {"mass": 1.25, "integrator": "implicit_euler", "duration": 0.2}
    context = EpisodeContext(
        "run", "cell", policy_id="ppo", policy_hash="abc", training_seed=3,
        training_discretization={"integrator": "rk4", "dt": 0.05}, perturbation={"mass": 1.2},
        first_episode=40, inference_latency_mean=900.0, inference_latency_p99=1500.0,
        replays=Replays(home=True), packages={"torch": "2.13.0"},
    )  # fmt: skip
    first, second = recorded(tmp_path, range(2), context, **arguments).records()
    for name, value in arguments.items():
        assert first.arguments()[name] == value
        if name not in ("mass", "integrator"):
            assert first[name] == pytest.approx(value, rel=1e-12)
    assert first["integrator"] == "implicit_euler"
    assert json.loads(first["arguments"])["mass"] == {"value": 1.25, "unit": "kg"}
    assert (first["substeps"], first["latency_budget"]) == (2, 0.02)
    assert first["solver_tolerance"] > 0.0
    assert [first["episode_index"], second["episode_index"]] == [40, 41]
    assert first["record_id"] == context.record_id(40) != second["record_id"]
    assert json.loads(first["training_discretization"]) == {"integrator": "rk4", "dt": 0.05}
    assert json.loads(first["perturbation"]) == {"mass": 1.2}
    packages = json.loads(first["package_versions"])
    assert (packages["torch"], packages["gymnasium"]) == ("2.13.0", gym.__version__)
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
def test_home_needs_no_replay(home, label, tmp_path):
    env = made(tmp_path, EpisodeContext("run", "cell", training_discretization=home))
    env.reset(seed=0, options={"state": (np.pi, 0.0)})
    run_out(env, np.zeros(1, np.float32))
    env.close()
    (record,) = EvidenceStore(tmp_path).records()
    assert record["failure_label"] == label


def test_what_a_label_rests_on_is_recorded(tmp_path):
    """By episode: whether the policy's replays succeeded, and what was known beside them."""
    env = made(tmp_path, EpisodeContext("run", "cell", training_discretization={"dt": 0.025}))
    play(env, range(4))
    said = {
        0: Replays(home=True, cell_status="unachievable", home_success=0.25, contract_kept=True),
        1: Replays(home=True, without_noise=False, without_delay=True, second_horizon=False),
        2: Replays(home="is home", cell_status="undecided", home_success=1.0),
    }
    env.commit(replays=said)
    records = list(EvidenceStore(tmp_path).records())
    names = (*Replays().columns(), "failure_label")
    assert [tuple(record[name] for name in names) for record in records] == [
        (True, None, None, None, 0.25, "unachievable", True, "unachievable"),
        (True, False, True, False, None, None, None, "discretization_error"),
        (None, None, None, None, 1.0, "undecided", None, records[2]["failure_label"]),
        (None, None, None, None, None, None, None, "unattributed"),
    ]
    assert records[2]["failure_label"] in ("control_error", "planning_error")
    assert EvidenceStore(tmp_path).verify() == []


def test_divergence_is_an_evaluation_error(tmp_path):
    settings = {"integrator": "explicit_euler", "dt": 1.0, "force_mag": 1e4, "duration": 10.0}
    env = made(tmp_path, CONTEXT, "IntegCartPole-v0", **settings)
    env.reset(seed=0)
    run_out(env, 1)
    env.close()
    (record,) = EvidenceStore(tmp_path).records()
    assert record["solver_status"] == "diverged"
    assert record["failure_label"] == "evaluation_error"
    assert record["solver_status_code"][-1] == 2


def test_saturation_fallback_and_recovery(tmp_path):
    env = made(tmp_path)
    env.reset(seed=0)
    for action in (np.nan, np.nan, 9.0, 9.0, 9.0, np.nan, 9.0, 0.0, 0.0, np.nan):
        env.step(np.array([action], dtype=np.float32))
    env.close()
    (record,) = EvidenceStore(tmp_path).records()
    assert (record["fallback_count"], record["recovery_count"]) == (4, 2)
    assert record["saturated_share"] == pytest.approx(0.4)


class _Constrained(IntegPendulumEnv):
    """A pendulum that reports a violated constraint."""

    def reset(self, **arguments):
        observation, info = super().reset(**arguments)
        return observation, info | {"constraint_violation": 0.0}

    def step(self, action):
        *result, info = super().step(action)
        return *result, info | {"constraint_violation": abs(self.state[1])}


def test_constraint_violation_is_recorded_where_there_is_any(tmp_path):
    with RecordEvidence(_Constrained(duration=0.5), tmp_path, CONTEXT) as env:
        play(env, [0])
    (record,) = EvidenceStore(tmp_path).records()
    assert record["env_id"] == "_Constrained"
    np.testing.assert_array_equal(record["constraint_violation"], abs(record["theta_dot"][1:]))
    assert record["constraint_violation_max"] == record["constraint_violation"].max()


@pytest.mark.parametrize(
    ("env_id", "arguments", "units"),
    [
        (PENDULUM, {"joint_limit": 1.0, "start": "uniform"}, ["rad", "rad", "N m"]),
        ("IntegCartPoleSwingUp-v0", {"track_limit": 0.02}, ["m", "m", "N"]),
    ],
)
def test_contact_is_recorded(env_id, arguments, units, tmp_path):
    env = made(tmp_path, CONTEXT, env_id, duration=1.0, integrator="rk4", dt=0.01, **arguments)
    ((_, steps),) = play(env, [0])
    env.close()
    (record,) = EvidenceStore(tmp_path).records()
    assert record["penetration_max"] > 0.0
    assert np.abs(record["contact_force"]).max() > 0.0
    assert record["contact_loss_total"] > 0.0
    assert record["contact_loss_total"] == pytest.approx(sum(i["contact_loss"] for _, i in steps))
    told = [record.units[name] for name in ("penetration", "penetration_max", "contact_force")]
    assert told == units


def test_unfinished_episodes_are_not_written(tmp_path):
    env = made(tmp_path)
    action = np.zeros(1, dtype=np.float32)
    env.reset(seed=0)
    env.step(action)
    env.reset(seed=1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for _ in range(11):  # one more than there are
            env.step(action)
    env.reset()
    env.step(action)
    env.close()
    (record,) = EvidenceStore(tmp_path).records()
    assert (record["seed"], record["episode_index"], record["length"]) == (1, 0, 10)


def test_keys_count_the_episodes_since_seeding(tmp_path):
    records = list(recorded(tmp_path, [None, None, 5, None, 2**70]).records())
    assert [record["seed"] for record in records] == [None, None, 5, 5, None]
    keys = [record["rng_key"].split("/") for record in records]
    assert [int(draws) for _, draws in keys] == [0, 1, 0, 1, 0]
    assert keys[0][0] == keys[1][0] != keys[2][0] == keys[3][0] == "5"
    assert int(keys[4][0]) == 2**70
    again = gym.make(PENDULUM)
    again.reset(seed=int(keys[0][0]))
    assert again.unwrapped.state.tolist() == records[0]["initial_state"]


def test_many_episodes_pass_through_a_small_buffer(tmp_path, monkeypatch):
    hashes = []
    for rows in (1, 4096):
        monkeypatch.setattr(recorder_module, "_FEWEST_ROWS", rows)
        records = recorded(tmp_path / str(rows), range(20), CONTEXT, "IntegCartPole-v0").records()
        hashes.append([record["content_hash"] for record in records])
    assert hashes[0] == hashes[1]


def test_records_are_committed_in_batches_or_taken(tmp_path):
    env = made(tmp_path)
    assert env.commit() is None
    assert env.take() is None
    play(env, [0])
    assert env.commit("mine") == tmp_path / "mine.parquet"
    play(env, [1])
    with pytest.raises(BatchExistsError, match="'mine' has already been committed"):
        env.commit("mine")
    taken = env.take()
    play(env, [2])
    store = EvidenceStore(tmp_path)
    store.commit_all("together", [taken, env.take(), None])
    play(env, [3])
    env.close()
    assert len(store.batches()) == 3
    assert sorted(record["episode_index"] for record in store.records()) == [0, 1, 2, 3]
    assert store.verify() == []


@pytest.mark.parametrize("env_id", [PENDULUM, "IntegCartPole-v0"])
def test_environment_stays_what_it_was(env_id, tmp_path):
    plain, env = gym.make(env_id), made(tmp_path, CONTEXT, env_id)
    for name in ("observation_space", "action_space", "metadata"):
        assert getattr(env, name) == getattr(plain, name)
    assert env.spec.id == env_id
    with pytest.raises(gym.error.ResetNeeded):
        env.step(env.action_space.sample())
    with warnings.catch_warnings():
        for message in ("different from the unwrapped version", "infinity", "normalized"):
            warnings.filterwarnings("ignore", message=f".*{message}.*")
        check_env(env, skip_render_check=True)


def test_what_changes_what_would_be_recorded_is_refused(tmp_path):
    wrappers = gym.wrappers
    env = gym.make(PENDULUM)
    for name, wrapped in (
        ("RescaleAction", wrappers.RescaleAction(env, np.float32(-1.0), np.float32(1.0))),
        ("TransformReward", wrappers.TransformReward(env, lambda reward: 2.0 * reward)),
    ):
        with pytest.raises(TypeError, match=rf"{name} changes.*around the environment first"):
            RecordEvidence(wrapped, tmp_path, CONTEXT)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"phase": "test"}, "`phase` must be one of training, evaluation, .*got 'test'"),
        ({"trace_every": 0}, "`trace_every` must be 1 or above, got 0"),
        ({"training_discretization": {"step": 0.1}}, "got {'step': 0.1}"),
        ({"training_discretization": [{}]}, "must have some of engine, integrator"),
    ],
)
def test_impossible_contexts_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        EpisodeContext("run", "cell", **arguments)


def test_records_of_another_phase_than_training_and_evaluation_have_ids_of_their_own():
    ids = {EpisodeContext("run", "cell", phase=phase).record_id(0) for phase in PHASES}
    assert len(ids) == len(PHASES) - 1


def test_no_zero_is_negative():
    """Not in traces and summaries, nor what is rounded to zero in the narrower columns."""
    setup = environment_setup(PENDULUM, {})
    layout = Layout(setup.plant, setup.task, None)
    log = EpisodeLog(layout, [EpisodeContext("run", "cell", trace_every=1)])
    rows = np.full((len(layout), 5), -0.0)
    rows[layout.place("sensed_theta_dot")] = -1e-60
    log.add(rows, np.array([5]), EpisodeHeads([0], [1], ["1/0"], [0], [0], [0], [0]))
    table = build_unhashed_table(log, PENDULUM, [(setup, 0)])
    seen = 0
    for name in table.column_names:
        values = table[name].combine_chunks()
        if pa.types.is_list(values.type):
            values = values.flatten()
        if pa.types.is_floating(values.type):
            numbers = values.drop_null().to_numpy(zero_copy_only=False)
            assert not np.signbit(numbers[numbers == 0.0]).any(), name
            seen += numbers.size
    assert seen > 5 * 10
