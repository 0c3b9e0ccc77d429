"""Runs put together hold each record once."""

from __future__ import annotations

import shutil
from dataclasses import replace

import gymnasium as gym
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from integ_gym.cli import main
from integ_gym.evidence.hashing import with_hashes
from integ_gym.evidence.recorder import RecordEvidence
from integ_gym.evidence.schema import EvidenceError
from integ_gym.evidence.store import EvidenceStore, merge


def _hashes(store):
    return {r["record_id"]: r["content_hash"] for r in store.records(trace=False)}


@pytest.fixture
def other(tmp_path_factory, context, play):
    """A store whose episodes 0 to 4 go beyond those of ``store``, the same as far as it goes."""
    directory = tmp_path_factory.mktemp("other")
    env = gym.make("IntegPendulum-v0", duration=0.5)
    env = RecordEvidence(env, directory, replace(context))
    play(env, range(5))
    env.close()
    return EvidenceStore(directory)


def test_what_is_there_already_is_left_out(store, other, two_environments, tmp_path_factory):
    target = EvidenceStore(tmp_path_factory.mktemp("both"))
    third = EvidenceStore(two_environments / "evidence")
    done = merge([store, other, third], target)
    assert done == (11, 3)
    assert _hashes(target) == _hashes(store) | _hashes(other) | _hashes(third)
    assert target.verify() == []
    assert merge([other, store], target) == (0, 8)
    assert target.count() == 11


def test_two_records_of_one_id_are_refused_before_anything_is_written(store, tmp_path):
    forged = EvidenceStore(tmp_path / "forged")
    forged.directory.mkdir()
    shutil.copy(store.files()[0], forged.directory)
    table = pq.read_table(forged.files()[0])
    place = table.schema.get_field_index("run_id")
    names = pa.array(["another"] * table.num_rows)
    changed = table.set_column(place, table.schema.field(place), names)
    pq.write_table(with_hashes(changed), forged.files()[0])
    target = EvidenceStore(tmp_path / "both")
    with pytest.raises(EvidenceError, match="is another than the one of that id"):
        merge([store, forged], target)
    assert target.files() == []


def test_a_damaged_run_is_not_merged(store, tmp_path):
    table = pq.read_table(store.files()[0])
    pq.write_table(pa.concat_tables([table, table]), store.files()[0])
    with pytest.raises(EvidenceError, match=r"is damaged: .*; mend it before it is merged"):
        merge([store], EvidenceStore(tmp_path / "both"))


def test_the_command(store, other, tmp_path_factory, capsys):
    out = tmp_path_factory.mktemp("out")
    argv = ["evidence", "merge", str(store.directory), str(other.directory), "--out", str(out)]
    assert main(argv) == 0
    assert capsys.readouterr().out.startswith(f"5 records written to {out}, 3 were there already")
    assert main(["evidence", "verify", str(out)]) == 0
