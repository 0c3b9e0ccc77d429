"""A panel's evidence, opened by other people's readers."""

from __future__ import annotations

import duckdb
import minari
import pandas as pd
import polars as pl
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from integ_gym.cli import main
from integ_gym.evidence.store import open_run

_EVALUATION = "phase = 'evaluation' AND episode_index = 0"


@pytest.fixture(scope="module")
def outcomes(panel_directory):
    """Success by record, as the panel's own store has it."""
    records = open_run(panel_directory).records(trace=False)
    return {record["record_id"]: record["success"] for record in records}


def _by_duckdb(files):
    sql = "SELECT record_id, success FROM read_parquet($1, union_by_name=true)"
    return dict(duckdb.execute(sql, [files]).fetchall())


def _by_polars(files):
    tables = (pl.read_parquet(file) for file in files)
    return dict(row for table in tables for row in table["record_id", "success"].rows())


def _by_pandas(files):
    frame = pd.concat(map(pd.read_parquet, files)).set_index("record_id")
    return frame["success"].to_dict()


@pytest.mark.parametrize("read", [_by_duckdb, _by_polars, _by_pandas])
def test_readers_of_tables_open_a_panel(panel_directory, outcomes, read):
    files = sorted(map(str, (panel_directory / "evidence").glob("*.parquet")))
    assert read(files) == outcomes


def _export(panel_directory, form, out):
    given = ["--to", form, "--out", str(out), "--where", _EVALUATION, "--no-progress"]
    assert main(["evidence", "export", str(panel_directory), *given]) == 0


def test_minari_opens_a_panel(panel_directory, outcomes, tmp_path):
    _export(panel_directory, "minari", tmp_path / "out")
    (path,) = (tmp_path / "out").glob("*/*/data")
    data = minari.MinariDataset(path)
    told = [x["integ_gym"] for x in data.storage.get_episode_metadata(data.episode_indices)]
    assert told
    assert all(outcomes[one["record_id"]] == one["success"] for one in told)
    lengths = [len(episode) for episode in data.iterate_episodes()]
    assert lengths == [one["length"] for one in told]


def test_readers_of_mcap_open_a_panel(panel_directory, outcomes, tmp_path):
    _export(panel_directory, "mcap", tmp_path / "out")
    files = list((tmp_path / "out").iterdir())
    assert files
    for file in files:
        with file.open("rb") as opened:
            reader = make_reader(opened, decoder_factories=[DecoderFactory()])
            (told,) = (x.metadata for x in reader.iter_metadata() if x.name.endswith(".record"))
            assert told["success"] == ("true" if outcomes[file.stem] else "false")
            messages = [x for *_, x in reader.iter_decoded_messages(topics=["/joint_states"])]
            assert len(messages) == int(told["length"]) + 1
