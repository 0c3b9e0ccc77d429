"""What is exported is opened by the format's own reader, and says what the records say."""

import json
import re
from pathlib import Path

import duckdb
import gymnasium as gym
import minari
import numpy as np
import pandas as pd
import polars as pl
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from recording import CONTEXT, made, recorded, run_out

from integ_gym.cli import main
from integ_gym.evidence.exporting import EXPORT_FORMATS, TEXT_FORMATS, export
from integ_gym.evidence.labels import EpisodeContext
from integ_gym.evidence.parquet_file import parts
from integ_gym.evidence.recorder import RecordEvidence
from integ_gym.evidence.schema import EvidenceError
from integ_gym.evidence.store import EvidenceStore, open_run
from integ_gym.support.files import read_bounded

FOLDERS = tuple(form for form in EXPORT_FORMATS if form not in TEXT_FORMATS)
CELLS = {"rk4": {"integrator": "rk4"}, "euler": {"integrator": "explicit_euler", "dt": 0.025}}


@pytest.fixture(scope="session", params=("IntegPendulum-v0", "IntegCartPole-v0"))
def run(request, tmp_path_factory):
    """Records of two cells, of which every second has a trace."""
    folder = tmp_path_factory.mktemp("exchange")
    for cell, settings in CELLS.items():
        context = EpisodeContext("a run", cell, policy_id="random", trace_every=2)
        settings = {"dt": 0.05, "control_period": 0.05, **settings}
        recorded(folder / "evidence", range(4), context, request.param, **settings)
    return open_run(folder)


def _exported(store, form, out):
    assert export(store, form, out) == (4, {"without a trace": 4})
    return {record["record_id"]: record for record in store.records() if record.trace}


def test_minari_reads_a_data_set(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    records = _exported(run, "minari", Path("datasets"))
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))
    (name,) = minari.list_local_datasets()
    data = minari.load_dataset(name)
    assert data.total_steps == sum(r["length"] for r in records.values())
    told = [one["integ_gym"] for one in data.storage.get_episode_metadata(range(4))]
    assert {one["record_id"] for one in told} == set(records)
    for episode, summary in zip(data.iterate_episodes(), told, strict=True):
        record = records[summary["record_id"]]
        assert summary == json.loads(json.dumps(record.summary()))
        sensed = [values for name, values in record.trace.items() if name.startswith("sensed_")]
        np.testing.assert_array_equal(episode.observations, np.stack(sensed, axis=1))
        np.testing.assert_array_equal(episode.rewards, record["reward"])
        assert episode.terminations[-1] == record["terminated"]
        assert episode.truncations[-1] == record["truncated"]
        assert len(episode.actions) == record["length"]
        assert all(map(data.action_space.contains, episode.actions))
        assert all(map(data.observation_space.contains, episode.observations))
        np.testing.assert_array_equal(episode.infos["energy"], record["energy"])
        np.testing.assert_array_equal(episode.infos["work"], [np.nan, *record["work"]])
    columns = data.storage.metadata["integ_gym"]["columns"]
    assert columns["energy"]["unit"] == "J"


def test_minari_plays_the_actions_again(run, tmp_path):
    """From the seed, in the environment that the data set names."""
    export(run, "minari", tmp_path / "out", where="cell = 'rk4'")
    (path,) = (tmp_path / "out").glob("*/*/data")
    data = minari.MinariDataset(path)
    env = data.recover_environment()
    for episode, told in zip(
        data.iterate_episodes(), data.storage.get_episode_metadata(range(2)), strict=True
    ):
        observation, _ = env.reset(seed=told["seed"])
        np.testing.assert_array_equal(observation, episode.observations[0])
        for action, after in zip(episode.actions, episode.observations[1:], strict=True):
            observation = env.step(action)[0]
            np.testing.assert_allclose(observation, after, rtol=1e-5, atol=1e-5)


def test_mcap_is_read_as_messages_of_ros_2(run, tmp_path):
    records = _exported(run, "mcap", tmp_path / "logs")
    files = {file.stem: file for file in (tmp_path / "logs").iterdir()}
    assert set(files) == set(records)
    for name, record in records.items():
        with files[name].open("rb") as opened:
            reader = make_reader(opened, decoder_factories=[DecoderFactory()])
            assert reader.get_header().profile == "ros2"
            told = {one.name: one.metadata for one in reader.iter_metadata()}
            heard: dict[str, list] = {}
            for schema, channel, message, decoded in reader.iter_decoded_messages():
                assert schema.name in ("std_msgs/msg/Float64", "sensor_msgs/msg/JointState")
                heard.setdefault(channel.topic, []).append((message.log_time, decoded))
        energy = [decoded.data for _, decoded in heard["/evidence/energy"]]
        assert energy == record["energy"].tolist()
        assert [t for t, _ in heard["/evidence/energy"]] == [
            round(1e9 * t) for t in record["time"].tolist()
        ]
        assert [x.data for _, x in heard["/evidence/work"]] == record["work"].tolist()
        for place, (time, state) in enumerate(heard["/joint_states"]):
            assert state.position == [record[joint][place] for joint in state.name]
            assert state.velocity == [record[f"{joint}_dot"][place] for joint in state.name]
            assert state.header.stamp.sec * 10**9 + state.header.stamp.nanosec == time
        assert len(heard["/joint_states"]) == record["length"] + 1
        assert told["integ_gym.unit"]["energy"] == "J"
        assert told["integ_gym.record"]["integrator"] == record["integrator"]


def test_an_export_to_parquet_is_a_run_with_the_same_records(run, tmp_path):
    assert export(run, "parquet", tmp_path / "out") == (8, {})
    assert main(["evidence", "verify", str(tmp_path / "out"), "--all", "--exact"]) == 0
    stored = {record["record_id"]: record["content_hash"] for record in run.records()}
    copied = open_run(tmp_path / "out").records()
    assert {record["record_id"]: record["content_hash"] for record in copied} == stored


def test_readers_of_tables_open_evidence(run):
    """Without this package: DuckDB, Polars and pandas agree on what stands there."""
    pattern = str(run.directory / "*.parquet")
    sql = 'SELECT record_id, "return", len(energy) AS n FROM read_parquet($1, union_by_name=true)'
    by_duckdb = {row[0]: row[1:] for row in duckdb.execute(sql, [pattern]).fetchall()}
    lengths = pl.col("energy").list.len().alias("n")
    table = pl.read_parquet(pattern).select("record_id", "return", lengths)
    by_polars = {row[0]: row[1:] for row in table.rows()}
    frames = pd.concat([pd.read_parquet(file) for file in run.files()])
    columns = (frames[name] for name in ("record_id", "return", "energy"))
    by_pandas = {i: (r, None if x is None else len(x)) for i, r, x in zip(*columns, strict=True)}
    own = {
        record["record_id"]: (record["return"], len(record["energy"]) if record.trace else None)
        for record in run.records()
    }
    assert by_duckdb == by_polars == by_pandas == own


@pytest.mark.parametrize("form", EXPORT_FORMATS)
def test_nothing_is_replaced_or_half_written(form, batch, monkeypatch, tmp_path):
    run, out = EvidenceStore(batch.parent), tmp_path / "out"
    out.write_text("as before")
    with pytest.raises(EvidenceError, match="exists, and is not replaced; give another --out"):
        export(run, form, out)
    assert out.read_text() == "as before"
    out.unlink()

    def broken(*read):
        yield from list(parts(*read))[:1]
        raise KeyboardInterrupt

    monkeypatch.setattr("integ_gym.evidence.selection.parts", broken)
    monkeypatch.setattr("integ_gym.evidence.selection.read", lambda *x, **y: 1 // 0)
    with pytest.raises((KeyboardInterrupt, ZeroDivisionError)):
        export(run, form, out)
    assert list(tmp_path.iterdir()) == []


def test_what_a_format_cannot_hold_is_refused(two_environments, tmp_path, capsys):
    store = open_run(two_environments)
    with pytest.raises(EvidenceError, match=r"and IntegPendulum-v0.*--where"):
        export(store, "minari", tmp_path / "out")
    with pytest.raises(EvidenceError, match="DuckDB refuses"):
        export(store, "csv", tmp_path / "out", where="no_such_column")
    with pytest.raises(EvidenceError, match="no record of"):
        export(store, "csv", tmp_path / "out", where="length < 0")
    with pytest.raises(ValueError, match="the format must be one of"):
        export(store, "xml", tmp_path / "out")
    assert main(["evidence", "export", str(two_environments), "--to", "mcap"]) == 2
    assert "say where with --out DIR" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_choice_that_was_none_is_left_out(tmp_path):
    for number, action in enumerate((0, np.nan)):
        context = EpisodeContext("run", f"cell {number}")
        env = made(tmp_path / "evidence", context, "IntegCartPole-v0", fallback="zero")
        env.reset(seed=0)
        run_out(env, action)
        env.close()
    store = open_run(tmp_path)
    done = export(store, "minari", tmp_path / "out")
    assert done.records == 1
    assert re.match("in which the fallback acted", *done.left_out)
    with pytest.raises(EvidenceError, match="all records are episodes in which the fallback"):
        export(store, "minari", tmp_path / "none", where="cell = 'cell 1'")


def test_records_of_any_environment_are_exported(tmp_path):
    env = RecordEvidence(gym.make("CartPole-v1"), tmp_path / "evidence", CONTEXT)
    env.reset(seed=0)
    run_out(env)
    env.close()
    store = open_run(tmp_path)
    for form in FOLDERS:
        out = tmp_path / form
        assert export(store, form, out).records == 1
        assert any(read_bounded(file) for file in out.rglob("*") if file.is_file())


class _Counting(gym.Env):
    """Somebody's environment, whose actions are what is asked for."""

    observation_space = gym.spaces.Box(-9, 9, (2, 2), np.int64)

    def __init__(self, actions):
        self.action_space = actions

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.left = 3
        return np.full((2, 2), self.left), {}

    def step(self, action):
        self.left -= 1
        return np.full((2, 2), self.left), 1.0, self.left == 0, False, {}


def _counted(actions, taken, folder):
    env = RecordEvidence(_Counting(actions), folder / "evidence", CONTEXT)
    env.reset(seed=0)
    for action in taken:
        env.step(action)
    env.close()
    return open_run(folder)


STRANGE = {
    "numbers": (gym.spaces.Discrete(3, start=-1), (-1, 1, 0)),
    "arrays": (gym.spaces.Discrete(3, start=5), (np.array([5]), np.array(7), np.int64(6))),
    "matrices": (gym.spaces.Box(-1, 1, (2, 3), np.float32), (np.eye(2, 3, dtype=np.float32),) * 3),
}


@pytest.mark.parametrize(("actions", "taken"), STRANGE.values(), ids=STRANGE)
def test_minari_gets_foreign_actions_as_they_were(actions, taken, tmp_path):
    run = _counted(actions, taken, tmp_path / "run")
    export(run, "minari", tmp_path / "out")
    (path,) = (tmp_path / "out").glob("*/*/data")
    data = minari.MinariDataset(path)
    (episode,) = data.iterate_episodes()
    np.testing.assert_array_equal(episode.actions, [np.reshape(x, actions.shape) for x in taken])
    assert all(map(actions.contains, episode.actions))
    assert data.action_space.dtype == actions.dtype
    assert episode.observations.tolist() == [[[k, k], [k, k]] for k in (3, 2, 1, 0)]


def test_minari_refuses_actions_that_it_could_not_give_back(tmp_path):
    run = _counted(gym.spaces.MultiDiscrete([2, 3]), [np.array([1, 2])] * 3, tmp_path / "run")
    with pytest.raises(EvidenceError, match="actions as values of their MultiDiscrete space"):
        export(run, "minari", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_an_exported_part_verifies_as_what_it_is(run, tmp_path, capsys):
    export(run, "parquet", tmp_path / "out", where="episode_index <> 1 AND cell = 'rk4'")
    assert main(["evidence", "verify", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    assert "of 8 records of a run, those that are \"episode_index <> 1 AND cell = 'rk4'\"" in told
    (file,) = (tmp_path / "out" / "evidence").iterdir()
    table = pq.read_table(file)
    pq.write_table(table.slice(0, table.num_rows - 1), file)
    assert main(["evidence", "verify", str(tmp_path / "out")]) == 1
    assert f"{file.name}: is not what was exported" in capsys.readouterr().out
