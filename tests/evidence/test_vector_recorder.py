"""Recording a vector environment gives the records of single ones."""

from __future__ import annotations

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from pairing import in_turn
from recording import CONTEXT

from integ_gym.evidence.fields import VOLATILE_NAMES
from integ_gym.evidence.labels import EpisodeContext, Replays
from integ_gym.evidence.recorder import RecordEvidence
from integ_gym.evidence.store import EvidenceStore
from integ_gym.evidence.vector_recorder import LaneBuffer, RecordVectorEvidence

LANES = 5
STEPS = 60
CASES = {
    "pendulum": ("IntegPendulum-v0", {"duration": 0.5, "integrator": "implicit_euler"}),
    "noise": (
        "IntegPendulum-v0",
        {"duration": 0.5, "dt": 0.025, "control_period": 0.05, "observation_noise": 0.1,
         "sensor_period": 0.075, "action_latency": 0.05},
    ),
    "periods": (
        "IntegPendulum-v0",
        {"duration": 0.5, "mixture": [
            {"integrator": "rk4", "dt": 0.05, "control_period": 0.05},
            {"integrator": "rk4", "dt": 0.05, "control_period": 0.1},
        ]},
    ),
    "cart-pole": ("IntegCartPole-v0", {"duration": 0.5, "theta_threshold": 0.1}),
}  # fmt: skip


def _actions(space, lane, step):
    """What a lane does in its step, whatever else is run beside it."""
    rng = np.random.default_rng([lane, step])
    if isinstance(space, gym.spaces.Discrete):
        return int(rng.integers(space.n))
    return rng.uniform(1.5 * space.low, 1.5 * space.high).astype(np.float32)


def _vector_actions(env, steps):
    """The lanes' actions; ``steps`` counts each lane's own control steps."""
    space = env.single_action_space
    return np.array([_actions(space, lane, step) for lane, step in enumerate(steps)])


def _run_vector(env, mode, seed=0):
    """Control steps that each lane has made when its time is up."""
    env.reset(seed=seed)
    steps = np.zeros(LANES, dtype=int)
    waiting = np.zeros(LANES, dtype=bool)
    for _ in range(STEPS):
        _, _, terminated, truncated, _ = env.step(_vector_actions(env, steps))
        done = terminated | truncated
        steps += ~waiting
        if mode is AutoresetMode.NEXT_STEP:
            waiting = done
        elif mode is AutoresetMode.DISABLED and done.any():
            env.reset(options={"reset_mask": done})
    return steps


def _run_single(env, lane, steps, seed=0):
    env.reset(seed=seed + lane)
    for step in range(steps):
        _, _, terminated, truncated, _ = env.step(_actions(env.action_space, lane, step))
        if terminated or truncated:
            env.reset()


def _made(directory, context=CONTEXT, *, episodes=None, every=100, lanes=LANES, **arguments):
    """Recorded lanes of a cart-pole whose episodes are short."""
    env = gym.make_vec("IntegCartPole-v0", num_envs=lanes, **{"duration": 0.5, **arguments})
    return RecordVectorEvidence(env, directory, context, episodes=episodes, commit_every=every)


def _by_key(directory):
    records = list(EvidenceStore(directory).records())
    assert EvidenceStore(directory).verify() == []
    keyed = {record["rng_key"]: record for record in records}
    assert len(keyed) == len(records)
    return keyed


def _assert_same(record, other, ignored):
    for name, value in record.fields.items():
        if name not in VOLATILE_NAMES and name not in ignored:
            assert value == other[name], name
    assert record.trace.keys() == other.trace.keys()
    for name, values in record.trace.items():
        np.testing.assert_array_equal(values, other.trace[name], err_msg=name)
        np.testing.assert_array_equal(np.signbit(values), np.signbit(other.trace[name]))
        assert values.dtype == other.trace[name].dtype


@pytest.mark.parametrize(("case", "mode"), in_turn(CASES, AutoresetMode))
def test_same_records_as_single_environments(case, mode, tmp_path):
    env_id, arguments = CASES[case]
    vector = gym.make_vec(env_id, num_envs=LANES, autoreset_mode=mode, **arguments)
    vector = RecordVectorEvidence(vector, tmp_path / "vector", CONTEXT)
    steps = _run_vector(vector, mode)
    vector.close()
    for lane in range(LANES):
        single = gym.make(env_id, **arguments)
        own = replace(CONTEXT, first_episode=1000 * lane)
        single = RecordEvidence(single, tmp_path / "single", own)
        _run_single(single, lane, steps[lane])
        single.close()
    found, expected = _by_key(tmp_path / "vector"), _by_key(tmp_path / "single")
    assert found.keys() == expected.keys()
    assert len(found) > 2 * LANES
    for key, record in found.items():
        _assert_same(record, expected[key], {"episode_index", "record_id"})
    indices = sorted(record["episode_index"] for record in found.values())
    assert indices == list(range(len(found)))


@pytest.mark.parametrize(("env_id", "arguments"), CASES.values(), ids=CASES)
def test_compiled_lanes_give_records_of_the_same_content(env_id, arguments, tmp_path):
    hashes = []
    for compiled in (False, True):
        env = gym.make_vec(env_id, num_envs=LANES, compiled=compiled, **arguments)
        env = RecordVectorEvidence(env, tmp_path / str(compiled), CONTEXT)
        _run_vector(env, AutoresetMode.NEXT_STEP)
        env.close()
        records = EvidenceStore(tmp_path / str(compiled)).records()
        hashes.append([record["content_hash"] for record in records])
    assert hashes[0] == hashes[1]
    assert len(hashes[0]) > 2 * LANES


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_paired_starts(mode, tmp_path):
    episodes = [40, 3, 17, 8, 21]
    env = _made(tmp_path, episodes=episodes, autoreset_mode=mode, theta_threshold=0.1)
    _run_vector(env, mode)
    assert env.recorded.all()
    assert sorted(env.summaries()["episode_index"].tolist()) == sorted(episodes)
    env.assign([k + 100 for k in episodes])
    assert not env.recorded.any()
    _run_vector(env, mode, seed=100)
    env.commit("both", {3: Replays(home=True)})
    records = list(EvidenceStore(tmp_path).records())
    assert [r["episode_index"] for r in records] == sorted(
        [*episodes, *(k + 100 for k in episodes)]
    )
    for record in records:
        late, index = divmod(record["episode_index"], 100)
        assert record["seed"] == episodes.index(index) + 100 * late
        assert record["rng_key"] == f"{record['seed']}/0"
        assert record["record_id"] == CONTEXT.record_id(record["episode_index"])
    env.assign([k + 200 for k in episodes])
    env.reset(seed=0)
    env.step(_vector_actions(env, [0] * LANES))
    env.close()
    assert EvidenceStore(tmp_path).batches() == ("both",), "what is not finished is not recorded"


@pytest.mark.parametrize("periods", [(0.05, 0.05), (0.05, 0.1)])
def test_mixture_and_array_parameters(periods, tmp_path):
    mixture = [
        {"integrator": "rk4", "dt": 0.05, "control_period": periods[0]},
        {"integrator": "explicit_euler", "dt": 0.025, "control_period": periods[1]},
    ]
    masses = np.array([0.5, 1.0, 1.5, 2.0, 2.5])
    env = gym.make_vec("IntegPendulum-v0", LANES, mixture=mixture, mass=masses, duration=0.5)
    env = RecordVectorEvidence(env, tmp_path, CONTEXT)
    _run_vector(env, AutoresetMode.NEXT_STEP)
    env.close()
    records = list(EvidenceStore(tmp_path).records())
    assert {record["integrator"] for record in records} == {"rk4", "explicit_euler"}
    for record in records:
        member = next(m for m in mixture if m["integrator"] == record["integrator"])
        assert record["dt"] == member["dt"]
        period = member["control_period"]
        assert record["control_period"] == record.arguments()["control_period"] == period
        assert record["substeps"] == round(period / member["dt"])
        assert record["length"] == round(0.5 / period)
        assert record.arguments()["mass"] == masses[record["seed"]]
        single = gym.make("IntegPendulum-v0", **record.arguments())
        single.reset(options={"state": record["initial_state"]})
        for k, torque in enumerate(record["torque_commanded"]):
            single.step(np.array([torque]))
            state = [record["theta"][k + 1], record["theta_dot"][k + 1]]
            np.testing.assert_allclose(single.unwrapped.state, state, rtol=1e-12)


@pytest.mark.parametrize("mode", AutoresetMode)
def test_environment_stays_what_it_was(mode, tmp_path):
    env = _made(tmp_path, autoreset_mode=mode)
    plain = gym.make_vec("IntegCartPole-v0", LANES, autoreset_mode=mode, duration=0.5)
    for name in ("spec", "metadata", "num_envs", "observation_space", "single_action_space"):
        assert getattr(env, name) == getattr(plain, name)
    seed = [3, 1, 4, 15, 9]
    np.testing.assert_array_equal(env.reset(seed=seed)[0], plain.reset(seed=seed)[0])
    for step in range(STEPS):
        actions = _vector_actions(plain, [step] * LANES)
        results = env.step(actions), plain.step(actions)
        for ours, theirs in zip(results[0][:4], results[1][:4], strict=True):
            np.testing.assert_array_equal(ours, theirs)
        assert results[0][4].keys() == results[1][4].keys()
        done = results[1][2] | results[1][3]
        if mode is AutoresetMode.DISABLED and done.any():
            options = {"reset_mask": done}
            np.testing.assert_array_equal(env.reset(options=options)[0][done],
                                          plain.reset(options=options)[0][done])  # fmt: skip


def test_reset_forgets_unfinished_episodes(tmp_path):
    env = gym.make_vec("IntegPendulum-v0", num_envs=2, duration=0.5, autoreset_mode="Disabled")
    env = RecordVectorEvidence(env, tmp_path, CONTEXT)
    zero = np.zeros((2, 1))
    env.reset(seed=[7, None])
    for _ in range(6):
        env.step(zero)
    env.reset(seed=[None, 9], options={"reset_mask": np.array([False, True])})
    for _ in range(4):
        env.step(zero)
    env.reset(options={"reset_mask": np.array([True, False])})
    for _ in range(6):
        env.step(zero)
    env.close()
    first, second = EvidenceStore(tmp_path).records()
    assert (first["seed"], first["rng_key"], first["length"]) == (7, "7/0", 10)
    assert (second["seed"], second["rng_key"], second["length"]) == (9, "9/0", 10)


def test_long_runs_fit_a_bounded_buffer(tmp_path, monkeypatch):
    monkeypatch.setattr("integ_gym.evidence.vector_recorder._ROWS_AT_ONCE", 500)
    context = EpisodeContext("run", "cell", phase="training", trace_every=10)
    env = _made(tmp_path, context, duration=2.0, theta_threshold=0.3)
    env.reset(seed=0)
    for step in range(700):
        env.step(_vector_actions(env, [step] * LANES))
    env.close()
    records = list(EvidenceStore(tmp_path).records())
    assert len(records) > 50
    for record in records:
        assert bool(record.trace) == (record["episode_index"] % 10 == 0)
        if record.trace:
            assert len(record["theta"]) == record["length"] + 1
            assert record["theta"][0] == record["initial_state"][2]
            np.testing.assert_array_equal(record["time"], np.arange(record["length"] + 1) * 0.02)
            moved = 0.02 * record["x_dot"][:-1]
            np.testing.assert_allclose(np.diff(record["x"]), moved, atol=1e-15)


def test_wrong_use_is_refused(tmp_path):
    for name in ("CartPole-v1", "Pendulum-v1"):
        with pytest.raises(TypeError, match="integ-gym environments, got"):
            RecordVectorEvidence(gym.make_vec(name, 2, "sync"), tmp_path, CONTEXT)
    env = gym.make_vec("IntegPendulum-v0", num_envs=4)
    for episodes in ([0, 0, 1, 2], [0, 1, 2]):
        with pytest.raises(ValueError, match=r"one index per lane \(4\), all different"):
            RecordVectorEvidence(env, tmp_path, CONTEXT, episodes=episodes)
    for contexts in ([CONTEXT] * 3, []):
        with pytest.raises(ValueError, match=r"must divide the number of lanes \(4\), got"):
            RecordVectorEvidence(env, tmp_path, contexts)
    with pytest.raises(ValueError, match="all different within a context"):
        RecordVectorEvidence(env, tmp_path, [CONTEXT] * 2, episodes=[0, 0, 1, 2])
    other = replace(CONTEXT, cell="other")
    RecordVectorEvidence(env, tmp_path, [CONTEXT, other], episodes=[0, 1, 0, 1]).close()


@pytest.mark.parametrize("paired", [True, False])
def test_lanes_are_shared_out_among_contexts(paired, tmp_path):
    """Every context has its own policy, count of episodes and replays."""
    names, lanes = ["a", "b", "c"], 2
    contexts = [replace(CONTEXT, policy_id=name, first_episode=10) for name in names]
    episodes = [0, 1] * 3 if paired else None
    env = _made(tmp_path, contexts, episodes=episodes, lanes=3 * lanes, theta_threshold=0.1)
    env.reset(seed=[7, 8] * 3)
    for step in range(STEPS):
        actions = [_actions(env.single_action_space, lane, step) for lane in range(lanes)]
        env.step(np.array(actions * 3))
    env.commit("batch", [{0: Replays(home=True)}, {}, {0: Replays(home=False)}])
    env.close()
    found = list(EvidenceStore(tmp_path).records())
    assert EvidenceStore(tmp_path).verify() == []
    assert [r["policy_id"] for r in found] == sorted(r["policy_id"] for r in found)
    labels = {(r["policy_id"], r["episode_index"]): r["failure_label"] for r in found}
    assert len(labels) == len(found)
    first = 0 if paired else 10
    for name in names:
        own = [index for policy, index in labels if policy == name]
        assert own == list(range(first, first + len(own)))
        assert len(own) == len(labels) // 3
        assert not paired or len(own) == lanes
    if paired:
        assert labels["a", 0] == "discretization_error" != labels["c", 0]
    said = {(r["policy_id"], r["episode_index"]): r["replay_home"] for r in found}
    own = {"a": True, "b": None, "c": False}
    assert said == {(name, k): None if k else own[name] for name, k in said}


def test_an_interrupt_while_rows_are_gathered_loses_nothing(monkeypatch, tmp_path):
    env = _made(tmp_path, every=None)
    env.reset(seed=0)
    for step in range(STEPS):
        env.step(_vector_actions(env, [step] * LANES))
    ended = env._count_waiting()

    def interrupted(buffer, waiting):
        raise KeyboardInterrupt

    for act in (env.summaries, env.close):
        with monkeypatch.context() as patched:
            patched.setattr(LaneBuffer, "_rows_of", interrupted)
            with pytest.raises(KeyboardInterrupt):
                act()
        assert env._count_waiting() == ended > LANES
    assert env.unwrapped.closed
    assert env.take()["episode_index"].to_pylist() == list(range(ended))


def test_batches_of_one_context_each_have_names_of_their_own(tmp_path):
    """Lanes that end apart are written one by one: an episode 0 for each context."""
    contexts = [replace(CONTEXT, policy_id=name) for name in "ab"]
    env = _made(tmp_path, contexts, episodes=[0, 0], every=1, lanes=2)
    env.reset(options={"state": np.array([[0.0, 0.0, 0.2, 1.0], [0.0, 0.0, 0.0, 0.0]])})
    for _ in range(25):
        env.step(np.array([0, 1]))
    env.close()
    found = list(EvidenceStore(tmp_path).records())
    assert [(r["policy_id"], r["episode_index"]) for r in found] == [("a", 0), ("b", 0)]
    assert found[0]["length"] < found[1]["length"]


def test_records_are_the_same_whatever_they_are_written_with(tmp_path, monkeypatch):
    """Episode by episode, all at once, and in many groups, each hashed beside the one before."""
    mixture, written = [{"dt": 0.02}, {"dt": 0.01}], {}
    for name, every, rows in (("singly", 1, 512), ("together", None, 512), ("in groups", None, 3)):
        monkeypatch.setattr("integ_gym.evidence.parquet_file._GROUP_BYTES", 1)
        monkeypatch.setattr("integ_gym.evidence.parquet_file._FEWEST_ROWS", rows)
        told = replace(CONTEXT, trace_every=2)
        env = _made(tmp_path / name, told, every=every, control_period=0.02, mixture=mixture)
        _run_vector(env, AutoresetMode.NEXT_STEP)
        env.close()
        store = EvidenceStore(tmp_path / name)
        assert not store.verify()
        written[name] = {record["record_id"]: record for record in store.records()}
    assert len(EvidenceStore(tmp_path / "singly").files()) > 5
    assert len(EvidenceStore(tmp_path / "together").files()) == 1
    for name, records in written.items():
        assert records.keys() == written["singly"].keys(), name
        for record_id, record in records.items():
            _assert_same(record, written["singly"][record_id], ())
