"""A panel whose directory is a place in an object store: the same records, whatever is killed."""

from __future__ import annotations

import os
import signal
import time

import pytest
from object_store import BUCKET, counts, served_bucket
from shared_panel import assert_equal_records, ended, kill_group, started, until, words

from integ_gym.cli import main
from integ_gym.eval.panel.running.run_directory import RunDirectory
from integ_gym.eval.panel.running.staging import retire
from integ_gym.support.sharing.claims import Claims
from integ_gym.support.sharing.folder_files import Gone
from integ_gym.support.storing.bucket import BucketStorage
from integ_gym.support.storing.places import fetched

pytestmark = pytest.mark.slow

LEASE = 8.0
OWN = "shared_panel:two_processes"


def _command(folder, run, *more):
    return words(folder, run, "--lease", f"{LEASE:g}", *more)


def _holders(storage):
    """Processes that hold a unit of the first session, by the unit, which nobody took over."""
    names = storage.files(".work/1/claims")
    chains = {}
    for name in names:
        unit, _, number = name.rpartition(".")
        if "plan-" not in unit and "-" in unit.rpartition("/")[2]:
            chains.setdefault(unit, set()).add(number)
    claims = storage.shared(".work/1")
    return {
        unit: int(claims.read(f"{unit}.1".removeprefix(".work/1/")))
        for unit, numbers in chains.items()
        if numbers == {"1"}
    }


def test_a_driver_is_killed_and_another_engines_goes_on(
    tmp_path, undisturbed, bucket, object_server, capsys
):
    first = started(_command(tmp_path, bucket), **object_server)
    with BucketStorage(bucket) as storage:
        until(lambda: [x for x in storage.files("units") if "train-" in x], first)
        kill_group(first)
        kept = storage.files("units")
        assert "panel.json" not in {name for name in storage.files("") if "/" not in name}
        again = started(_command(tmp_path, bucket, "--executor", OWN), **object_server)
        assert ended(again) == 0
        assert set(kept) < set(storage.files("units"))
        assert not [name for name in storage.files("") if "staged" in name]
    with fetched(bucket) as run:
        assert_equal_records(run, undisturbed)
        assert (run / "seal.json").exists()
    sql = "SELECT record_id, content_hash FROM records ORDER BY ALL"
    told = []
    for where in (bucket, str(undisturbed)):
        assert main(["evidence", "query", where, sql, "--format", "csv"]) == 0
        told.append(capsys.readouterr().out)
    assert told[0] == told[1]
    assert main(["evidence", "query", bucket, "COPY records TO '/tmp/x.csv'"]) == 2
    assert main(["evidence", "query", bucket, "SELECT * FROM read_csv('/etc/passwd')"]) == 2
    assert main(["evidence", "verify", bucket, "--sample", "20"]) == 0
    assert main(["report", bucket]) == 0
    assert main(["evidence", "verify", bucket, "--depth", "sealed"]) == 0
    assert f"Page: {bucket}/report.html" in capsys.readouterr().out


@pytest.mark.parametrize("engine", ["dask", "ray"])
def test_two_processes_of_an_engine_give_the_same_records(
    tmp_path, undisturbed, bucket, object_server, engine
):
    """Each works in a copy of its own, with the credentials of the environment."""
    command = _command(tmp_path, bucket, "--executor", engine)
    assert ended(started(command, **object_server)) == 0
    with fetched(bucket) as run:
        assert_equal_records(run, undisturbed)
        assert (run / "seal.json").exists()


def test_workers_of_which_one_is_killed_and_one_sleeps_beyond_its_lease(
    tmp_path, undisturbed, bucket, object_server
):
    command = _command(tmp_path, bucket, "--worker")
    workers = {one.pid: one for one in (started(command, **object_server) for _ in range(4))}
    with BucketStorage(bucket) as storage:
        some = next(iter(workers.values()))
        held = until(lambda: _holders(storage), some)
        unit, sleeper = next(iter(held.items()))
        os.kill(sleeper, signal.SIGSTOP)
        killed = next(pid for pid in workers if pid != sleeper)
        os.kill(killed, signal.SIGKILL)
        alive = next(one for pid, one in workers.items() if pid not in (sleeper, killed))
        until(lambda: f"{unit}.2" in storage.files(unit.rpartition("/")[0]), alive)
        os.kill(sleeper, signal.SIGCONT)
    codes = {pid: ended(one) for pid, one in workers.items()}
    assert codes.pop(killed) == -signal.SIGKILL
    assert set(codes.values()) == {0}
    with fetched(bucket) as run:
        assert_equal_records(run, undisturbed)
    before = counts(object_server["AWS_ENDPOINT_URL"])
    assert ended(started(command, **object_server)) == 0, "one that comes late has nothing to do"
    with fetched(bucket) as run:
        assert_equal_records(run, undisturbed)
    assert before != counts(object_server["AWS_ENDPOINT_URL"])


def _staged(storage, text):
    """A run in which a unit's results wait, of one that may be the last to wake."""
    directory = RunDirectory(storage, {})
    directory.make_folders()
    with directory.kept():
        desk = directory.desk
        plan = desk.add_plan([{"name": "train-a"}])
        claim = Claims(desk.claims_of(plan), ["train-a"]).seize("train-a")
        there = RunDirectory(desk.staged(claim), {})
        there.make_folders()
        (there.evidence / "train-a.parquet").write_text(text)
        there.finish("train-a", "key", time.time(), policy="hash")
    return desk, claim


def test_what_was_decided_is_put_in_place_by_whoever_comes_next(bucket):
    with BucketStorage(bucket) as storage:
        desk, claim = _staged(storage, "first")
        desk.hand_in(claim)
        assert claim.commit()
        with RunDirectory(storage, {}).kept():
            assert storage.files("evidence") == ["evidence/train-a.parquet"]
            assert storage.files("units") == ["units/train-a.json"]
        desk.put_in_place(claim)
        assert storage.files("evidence") == ["evidence/train-a.parquet"]


def test_whoever_wakes_after_another_took_the_run_over_changes_nothing(bucket):
    with BucketStorage(bucket) as storage:
        desk, claim = _staged(storage, "sleeper")
        with RunDirectory(storage, {}).kept():
            desk.hand_in(claim)
            assert not claim.commit()
            with pytest.raises(Gone):
                desk.add_plan([{"name": "train-b"}])
            with pytest.raises(Gone):
                desk.check()
        assert storage.files("evidence") == []


def test_whoever_wakes_after_all_is_done_changes_nothing(bucket):
    """What refuses is there for good, while the rest of the work is removed."""
    with BucketStorage(bucket) as storage:
        _, sleeper = _staged(storage, "sleeper")
        number = RunDirectory(storage, {})
        with number.kept():
            pass
        desk, _ = _staged(storage, "other")
        other = Claims(desk.claims_of("0"), ["train-a"]).seize("train-a")
        assert other.number == 2
        assert other.commit()
        desk.finish()
        assert not other.renew()
        assert not sleeper.commit()
        assert (
            not Claims(desk.run.shared(f"{desk.folder}/claims/0"), ["train-a"])
            .seize("train-a")
            .commit()
        )
        retire(storage, own="9")
        assert storage.files("evidence") == []


def test_a_store_that_does_not_heed_conditions_is_refused(tmp_path):
    with served_bucket("no If-None-Match") as told:
        process = started(words(tmp_path, f"{BUCKET}/run"), **told)
        assert ended(process) == 2
        worker = started(words(tmp_path, f"{BUCKET}/run", "--worker"), **told)
        assert ended(worker) == 2
        for name, value in told.items():
            os.environ[name] = value
        with BucketStorage(f"{BUCKET}/run") as storage:
            assert storage.folders("") == []
        for name in told:
            os.environ.pop(name)
