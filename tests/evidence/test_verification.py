"""What was forged, dropped or swapped in records is named, with what it comes out as."""

import shutil
from functools import partial
from itertools import pairwise
from random import Random

import numpy as np
import pyarrow.parquet as pq
import pytest
from forgery import with_column
from pairing import in_turn
from recording import PENDULUM, made, recorded

import integ_gym
from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.evidence import replaying
from integ_gym.evidence.hashing import with_hashes
from integ_gym.evidence.labels import EpisodeContext, Replays
from integ_gym.evidence.recomputing import recompute
from integ_gym.evidence.replaying import missing_episodes, replay, replay_some
from integ_gym.evidence.schema import EvidenceError
from integ_gym.evidence.sealing import (
    SEAL_FILE,
    find_broken_seals,
    read_seal,
    seal,
)
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.policy import BoxActions, MlpPolicy

SETTINGS = {
    "plain": {},
    "implicit": {"integrator": "implicit_midpoint"},
    "late": {
        "dt": 0.01, "control_period": 0.02, "action_latency": 0.03, "sensor_period": 0.05,
        "observation_noise": 0.01,
    },
    "lossy": {
        "dt": 0.01, "control_period": 0.02, "action_latency": 0.03, "latency_jitter": 0.03,
        "hold_probability": 0.1,
    },
    "coarse": {"integrator": "explicit_euler", "dt": 0.2, "control_period": 0.2},
}  # fmt: skip


def _recorded(directory, env_id=PENDULUM, episodes=4, **settings):
    context = EpisodeContext("run", "cell", policy_id="random", replays=Replays(home=False))
    return recorded(directory, range(episodes), context, env_id, duration=1.0, **settings)


@pytest.fixture(scope="module")
def four(tmp_path_factory):
    return _recorded(tmp_path_factory.mktemp("four")).directory


@pytest.fixture
def untouched(tmp_path, four):
    """A store of four records, which may be forged."""
    return EvidenceStore(shutil.copytree(four, tmp_path / "evidence"))


def _found(store):
    return [str(x) for name, record in store.named_records() for x in recompute(record, name)]


def _replayed(store, **options):
    return replay(list(store.named_records()), **options).settle()


def _forge(store, column, change):
    """Change a column of the only file, and make its hashes fit."""
    (file,) = store.files()
    table = pq.read_table(file)
    made = with_column(table, column, change(table.column(column).to_pylist()))
    pq.write_table(with_hashes(made), file)
    assert store.verify() == []


@pytest.mark.parametrize(("env_id", "kind"), in_turn(ENVIRONMENTS, SETTINGS))
def test_what_was_recorded_comes_out_again_to_the_last_bit(env_id, kind, tmp_path):
    store = _recorded(tmp_path, env_id, **SETTINGS[kind])
    assert _found(store) == []
    assert list(missing_episodes(store)) == []
    done = _replayed(store, exact=True)
    assert (done.findings, done.records, done.exact, done.skipped) == ([], 4, 4, {})


def test_figures_of_every_contact_point_are_recorded_and_come_out_again(tmp_path, monkeypatch):
    monkeypatch.setitem(ENVIRONMENTS, "TouchingRod-v0", "touching:Rod")
    store = _recorded(tmp_path, "touching:TouchingRod-v0")
    assert _found(store) == []
    record = next(iter(store.records()))
    figures = ("penetration", "normal_force", "tangential_force", "slip_speed")
    names = [f"{name}_{figure}" for name in ("left", "right") for figure in figures]
    assert [record.units[name] for name in names] == ["m", "N", "N", "m/s"] * 2
    assert all(np.nanmax(np.abs(record[name])) > 0.0 for name in (*names, "slip_loss"))
    deepest = np.maximum(record["left_penetration"], record["right_penetration"])
    np.testing.assert_array_equal(record["penetration"], deepest)
    assert record["penetration_max"] == np.nanmax(deepest)
    assert record["contact_loss_total"] >= np.nansum(record["slip_loss"]) > 0.0
    done = _replayed(store, exact=True)
    assert (done.findings, done.records, done.exact) == ([], 4, 4)
    _forge(store, "left_normal_force", lambda rows: [[x and x + 1.0 for x in r] for r in rows])
    assert "`left_normal_force[" in str(_replayed(store).findings[0])


def test_the_last_bit_counts_if_asked_for(untouched):
    _forge(untouched, "energy", lambda rows: [[*row[:-2], np.nextafter(row[-2], 9.0), row[-1]]
                                              for row in rows])  # fmt: skip
    done = _replayed(untouched)
    assert (done.findings, done.exact, done.records) == ([], 0, 4)
    assert len(_replayed(untouched, exact=True).findings) == 4


def test_what_does_not_end_as_recorded_is_named(tmp_path):
    store = _recorded(tmp_path, "IntegCartPole-v0")
    _forge(store, "force_commanded", lambda rows: [[x and -x for x in row] for row in rows])
    assert _replayed(store).findings


def test_no_code_that_a_record_names_is_run(untouched, tmp_path, monkeypatch):
    (tmp_path / "trap.py").write_text("raise SystemExit('executed')")
    monkeypatch.syspath_prepend(str(tmp_path))
    named, trap = '"value":"symplectic_euler"', '"value":"trap:Map"'
    _forge(untouched, "arguments", lambda values: [x.replace(named, trap) for x in values])
    assert _found(untouched) == []
    done = _replayed(untouched)
    assert (done.records, list(done.skipped.values())) == (0, [4])
    with pytest.raises(SystemExit, match="executed"):
        _replayed(untouched, own_code=True)


def test_records_without_a_trace_are_checked_as_far_as_they_go(tmp_path):
    store = recorded(tmp_path, range(4), EpisodeContext("run", "cell", trace_every=2))
    assert _found(store) == []
    assert _replayed(store).skipped == {"without a trace": 2}


def test_the_only_one_of_a_file_whose_bits_differ_is_named_however_little(tmp_path):
    store = _recorded(tmp_path, episodes=20)
    _forge(store, "energy_end", lambda values: [values[0] * (1.0 + 1e-9), *values[1:]])
    done = _replayed(store)
    assert (done.exact, done.records) == (19, 20)
    (found,) = done.findings
    assert "`energy_end` is recorded as" in found.message


def test_another_machine_s_rounding_is_told_from_a_forgery(tmp_path, monkeypatch):
    """Recorded controls leave a pendulum to itself: an ulp grows with every swing."""
    context = EpisodeContext("run", "cell", replays=Replays(home=False))
    store = recorded(tmp_path, range(8), context, duration=20.0)
    start = replaying._start

    def rounded(recorder, records, nudge):
        if nudge:
            return start(recorder, records, nudge)
        states = np.array([record.fields["initial_state"] for record in records])
        return recorder.reset(options={"state": np.nextafter(states, np.inf)})[0]

    monkeypatch.setattr(replaying, "ELSEWHERE", 1e-14)
    with monkeypatch.context() as elsewhere:
        elsewhere.setattr(replaying, "_start", rounded)
        done = _replayed(store)
        assert (done.findings, done.exact) == ([], 0)
        assert done.sensitive
        whole = store.files()[0].read_bytes()
        _forge(store, "energy_residual_total", lambda values: [None, *values[1:]])
        (gone,) = {finding.record_id for finding in _replayed(store).findings}
        assert gone == next(store.records())["record_id"]
        store.files()[0].write_bytes(whole)
        _forge(store, "theta_dot", lambda rows: [[*row[:9], row[9] + 1e-3, *row[10:]]
                                                 for row in rows])  # fmt: skip
        assert len({finding.record_id for finding in _replayed(store).findings}) == 8
    assert not _replayed(store).sensitive


@pytest.fixture
def sealed(tmp_path, four):
    run = tmp_path / "run"
    shutil.copytree(four, run / "evidence")
    (run / "policies" / "a").mkdir(parents=True)
    (run / "policies" / "a" / "policy.json").write_text("{}")
    pinned = seal(run)
    assert read_seal(run)["seal"] == pinned
    assert list(find_broken_seals(run)) == []
    return run


def _flip(file):
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


def test_a_seal_that_was_made_to_fit_is_another(sealed):
    (file,) = sealed.glob("evidence/*.parquet")
    before = read_seal(sealed)["seal"]
    text = (sealed / SEAL_FILE).read_text()
    _flip(file)
    assert seal(sealed) != before
    (sealed / SEAL_FILE).write_text(text.replace(before, "0" * 64))
    assert "its own hash does not fit" in "\n".join(map(str, find_broken_seals(sealed)))
    (sealed / SEAL_FILE).write_text("[]")
    with pytest.raises(EvidenceError, match=r"a list where an object was expected; restore it"):
        read_seal(sealed)


def _lean(observations):
    """What a policy would do: the same for the same observation, on any machine."""
    return np.clip(-3.0 * observations[:, 1:2], -2.0, 2.0).astype(np.float32)


def _acted(directory, seeds=range(3), trace_every=2, **settings):
    """Episodes of that policy, none of whose controls are seen in every second."""
    context = EpisodeContext(
        "run", "cell", policy_id="lean", policy_hash="1", trace_every=trace_every
    )
    with made(directory, context, duration=2.0, **settings) as env:
        for seed in seeds:
            observation, _ = env.reset(seed=seed)
            ended = False
            while not ended:
                observation, _, _, ended, _ = env.step(_lean(observation[None])[0])
    return EvidenceStore(directory)


@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
def test_a_policy_decides_again_without_a_trace_and_with_noise(settings, tmp_path):
    store = _acted(tmp_path, **settings)
    done = _replayed(store, exact=True, policy=lambda record: _lean)
    assert (done.findings, done.records, done.exact, done.skipped) == ([], 3, 3, {})


def test_a_count_of_the_fallback_that_no_trace_tells_is_what_the_policy_comes_to(tmp_path):
    """Where a control is repeated, the fallback may have held it."""
    store = _acted(tmp_path, trace_every=1)
    again = partial(replay_some, store, None, Random(0))
    done = again(lambda record: _lean)
    assert (done.findings, done.records, done.undecided) == ([], 3, {})
    _forge(store, "fallback_count", lambda counts: [counts[0] + 1, *counts[1:]])
    assert _found(store) == []
    (finding,) = again(lambda record: _lean).findings
    assert "`fallback_count`" in finding.message
    done = again(_gone)
    assert (done.findings, done.undecided.total()) == ([], 3)
    _forge(store, "recovery_count", lambda counts: [*counts[:2], None])
    assert [line for line in _found(store) if "`recovery_count` is recorded as None" in line]


def _gone(record):
    raise ValueError("it is gone")


def test_the_noise_of_later_episodes_is_drawn_again_and_an_earlier_version_s_is_not(tmp_path):
    """Once it came from the generator of the starts, and is not held against ours."""
    store = _acted(tmp_path, (4, None, None), 1, observation_noise=0.05)
    whole = store.files()[0].read_bytes()
    for policy in (None, lambda record: _lean):
        done = _replayed(store, exact=True, policy=policy)
        assert (done.findings, done.records, done.exact, done.skipped) == ([], 3, 3, {})
    (sensed, *_) = [name for name in next(store.records()).trace if name.startswith("sensed_")]
    _forge(store, sensed, lambda traces: [*traces[:2], [x + 1e-3 for x in traces[2]]])
    (finding,) = _replayed(store).findings
    assert sensed in str(finding)
    store.files()[0].write_bytes(whole)
    _forge(store, "schema_version", lambda values: [3 for _ in values])
    done = _replayed(store)
    assert (done.findings, done.records, done.exact) == ([], 3, 3)
    done = _replayed(store, policy=lambda record: _lean)
    assert done.skipped == {"whose noise cannot be drawn again": 3}


def test_what_another_policy_did_is_named_and_one_that_is_gone_decides_nothing(tmp_path, untouched):
    store = _acted(tmp_path / "acted")
    done = _replayed(store, policy=lambda record: lambda x: 0.9 * _lean(x))
    assert {finding.record_id for finding in done.findings} == {
        record["record_id"] for record in store.records(trace=False)
    }

    done = _replayed(store, policy=_gone)
    assert done.skipped == {"whose policy cannot decide again: it is gone": 3}
    reason = "of training or of a policy without a hash, whose controls are unknown"
    assert _replayed(untouched, policy=_gone).skipped == {reason: 4}


def hop(observation):
    return 0.9 * np.tanh(observation[-3:])


def step(observation):
    return int(observation[0] > 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("policy", "env_id", "integrator", "dt", "varied", "environment"),
    [
        (
            hop, "Hopper-v5", "RK4", 0.002,
            {"control_period": [0.008, 0.016], "solver": {"iterations": [1, 100]}},
            {"success_return": 100.0},
        ),
        (
            hop, "Hopper-v5", "RK4", 0.002, {"hold_probability": [0.0, 0.2]},
            {"action_latency": 0.004, "latency_jitter": 0.01},
        ),
        (step, "CartPole-v1", "explicit_euler", 0.02, {"control_period": [0.02, 0.04]}, {}),
        (
            step, "CartPole-v1", "explicit_euler", 0.02,
            {"hold_probability": [0.2], "latency_jitter": [0.0, 0.04]}, {},
        ),
    ],
)  # fmt: skip
def test_every_record_comes_out_to_the_last_bit(
    policy, env_id, integrator, dt, varied, environment, tmp_path
):
    integ_gym.evaluate(
        policy, env_id, tmp_path, home="stock", integrators=[integrator], dts=[dt], episodes=3,
        varied=varied, at=["home"], environment=environment, workers=1, progress=False,
        on_doubt=lambda doubt: None,
    )  # fmt: skip
    records = list(EvidenceStore(tmp_path / "evidence").named_records())
    done = replay(records, exact=True).settle()
    assert done.findings == []
    assert done.skipped == {}
    assert done.exact == done.records == len(records)
    file, forged = records[0]
    forged.trace["reward"] = forged.trace["reward"] + 1e-9
    assert replay([(file, forged)], exact=True).settle().findings


@pytest.mark.slow
def test_what_a_network_decided_on_another_engine_is_decided_again_to_the_last_bit(tmp_path):
    """Second horizons have no traces, and a network's last bits depend on how much it is shown."""
    rng, sizes = np.random.default_rng(0), (3, 64, 64, 1)
    layers = tuple(
        (rng.normal(size=(n, m)).astype(np.float32), rng.normal(size=n).astype(np.float32))
        for m, n in pairwise(sizes)
    )
    policy = MlpPolicy(layers, "Tanh", BoxActions(np.array([-0.5]), np.array([0.5])))
    integ_gym.evaluate(
        policy, "IntegPendulum-v0", tmp_path, integrators=["Euler"], dts=[0.05], episodes=10,
        home={"engine": "mujoco", "integrator": "Euler", "dt": 0.05, "control_period": 0.05},
        environment={"duration": 2.0, "max_torque": 0.5}, workers=1, progress=False,
    )  # fmt: skip
    store = EvidenceStore(tmp_path / "evidence")
    decided = store.query(
        "SELECT record_id FROM records WHERE phase = 'second_horizon' AND engine = 'mujoco' "
        "AND policy_id = 'mlp'"
    )
    names = frozenset(decided.column("record_id").to_pylist())
    done = replay(
        list(store.named_records(names)), exact=True, policy=lambda record: policy.act
    ).settle()
    assert done.exact == len(names) > 0
    assert not done.findings


@pytest.mark.parametrize("env_id", ["IntegAcrobotSwingUp-v0", "IntegCartPoleSwingUp-v0"])
def test_an_episode_from_a_given_state_is_replayed(env_id, tmp_path):
    """In whichever order the environment takes its states."""
    context = EpisodeContext("run", "cell", policy_id="random", replays=Replays(home=False))
    env = made(tmp_path, context, env_id, duration=0.5)
    env.reset(seed=1, options={"state": (0.1, 0.2, 0.3, 0.4)})
    ended = False
    while not ended:
        ended = any(env.step(env.action_space.sample())[2:4])
    env.close()
    done = _replayed(EvidenceStore(tmp_path))
    assert (done.exact, done.records, done.findings) == (1, 1, [])
