"""Claims, sessions and a copy's files in an object store, over HTTP."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

import obstore
import pytest
from object_store import BUCKET, served_bucket

from integ_gym.support.sharing.claims import Claims, close_units
from integ_gym.support.sharing.folder_files import Gone
from integ_gym.support.sharing.holding import held
from integ_gym.support.storing import objects
from integ_gym.support.storing.bucket import BucketStorage
from integ_gym.support.storing.objects import StorageError
from integ_gym.support.storing.storage import Busy

pytestmark = pytest.mark.slow

LEASE = 3.0
"""Longer than the second to which a store tells times, s."""


@pytest.fixture
def storage(bucket):
    with BucketStorage(bucket) as opened:
        yield opened


@pytest.fixture
def files(storage):
    return storage.shared(".work/1/claims")


def _claims(files, units=("a", "b"), lease=LEASE):
    return Claims(files, units, lease)


def test_a_file_is_made_by_one(files):
    start = threading.Barrier(8)

    def make(number):
        start.wait()
        return files.create("one", str(number))

    with ThreadPoolExecutor(8) as pool:
        made = [*pool.map(make, range(8))]
    assert made.count(True) == 1
    assert files.read("one") == str(made.index(True))
    assert files.names("") == ["one"]


def test_a_repeated_request_is_told_from_another_that_was_faster(files, monkeypatch):
    put = obstore.put

    def put_and_lose_the_answer(store, name, content, **told):
        put(store, name, content, **told)
        return put(store, name, content, **told)

    monkeypatch.setattr(obstore, "put", put_and_lose_the_answer)
    assert files.create("one", "text")
    monkeypatch.undo()
    assert not files.create("one", "text")


def test_whoever_wakes_after_its_lease_cannot_commit(files):
    sleeper = _claims(files, ["a"]).take()
    other = _claims(files, ["a"])
    assert other.take() is None, "its holder is heard of"
    time.sleep(LEASE + 2.0)
    taken = _claims(files, ["a"]).take()
    assert (taken.number, taken.decided) == (2, False)
    assert not sleeper.renew()
    assert not sleeper.commit()
    assert taken.commit()


def test_a_holder_that_is_heard_of_is_not_taken_over(files):
    claim = _claims(files, ["a"]).take()
    with held(claim, LEASE):
        time.sleep(LEASE + 2.0)
        assert _claims(files, ["a"]).take() is None
    assert claim.commit()


def test_an_ended_chain_commits_nothing(files):
    claims = _claims(files, ["free", "held", "decided", "done"], lease=0.0)
    kept = {name: claims.seize(name) for name in ("held", "decided", "done")}
    assert kept["decided"].commit()
    assert kept["done"].commit()
    kept["done"].finish()
    assert [claim.unit for claim in close_units(files, [["free", "held", "decided", "done"]])] == [
        "decided"
    ]
    assert not kept["held"].commit()
    with pytest.raises(Gone):
        claims.seize("free")
    with pytest.raises(Gone):
        claims.seize("held")
    assert not [*close_units(files, [["free", "held"]])], "it may be ended twice"


def test_a_copy_follows_and_is_sent(storage, bucket):
    (storage.path / "units").mkdir()
    (storage.path / "units" / "a.json").write_text("a")
    (storage.path / "run.json").write_text("first")
    storage.keep("units")
    storage.publish("run.json")
    with BucketStorage(bucket) as other:
        other.fetch()
        assert (other.path / "units" / "a.json").read_text() == "a"
        assert not other.changed()
        (other.path / "run.json").write_text("second")
        assert other.changed() == ["run.json"]
        other.publish("run.json")
        (storage.path / "run.json").write_text("third")
        with pytest.raises(Busy):
            storage.publish("run.json")
        storage.fetch("run.json")
        assert (storage.path / "run.json").read_text() == "second"
        (other.path / "units" / "a.json").unlink()
        other.drop_missing()
        assert other.files("units") == []
    storage.fetch()
    assert not (storage.path / "units" / "a.json").exists()


def test_what_was_changed_meanwhile_is_not_removed(storage, bucket):
    (storage.path / "a.json").write_text("first")
    storage.publish("a.json")
    with BucketStorage(bucket) as other:
        other.fetch()
        (other.path / "a.json").write_text("second")
        other.publish("a.json")
        (storage.path / "a.json").unlink()
        storage.drop_missing()
        other.fetch("a.json")
        assert (other.path / "a.json").read_text() == "second"


def test_one_alone_or_many_together(bucket):
    with ExitStack() as stack:
        one, two = (stack.enter_context(BucketStorage(bucket)) for _ in range(2))
        with one.held(True, LEASE) as first:
            with pytest.raises(Busy), two.held(True, LEASE):
                pass
            with pytest.raises(Busy), two.held(False, LEASE):
                pass
        with one.held(False, LEASE) as second, two.held(False, LEASE) as third:
            assert second == third
        assert first != second


def test_who_is_silent_for_its_lease_is_taken_for_dead(bucket, monkeypatch, capsys):
    with ExitStack() as stack:
        one, two = (stack.enter_context(BucketStorage(bucket)) for _ in range(2))
        monkeypatch.setattr(
            "integ_gym.support.storing.sessions.Sessions._beat", lambda *given: None
        )
        with one.held(True, LEASE) as dead, two.held(True, LEASE) as alive:
            assert (dead, alive) == ("1", "2")
    assert "waiting for at most" in capsys.readouterr().err


@pytest.mark.parametrize("fault", ["no If-None-Match", "no If-Match"])
def test_a_store_that_does_not_heed_conditions_is_refused(fault, monkeypatch):
    with served_bucket(fault) as told:
        for name, value in told.items():
            monkeypatch.setenv(name, value)
        with BucketStorage(f"{BUCKET}/run") as storage:
            with pytest.raises(ValueError, match="cannot be shared") as refused:
                storage.check()
            assert f"({fault[3:]}" in str(refused.value)
            assert storage.folders("") == [], "nothing is left"


def test_a_store_that_heeds_them_is_not(storage):
    storage.check()
    assert storage.folders("") == []


def test_a_bucket_that_is_not_there_is_told_in_a_sentence(bucket):
    with (
        BucketStorage(bucket.replace("bucket", "another-bucket", 1)) as storage,
        pytest.raises(StorageError, match="see that the bucket is there"),
    ):
        storage.check()


def test_no_plain_endpoint_is_asked_unless_it_was_named(monkeypatch):
    for name in objects.ENDPOINTS:
        monkeypatch.delenv(name, raising=False)
    assert objects.client_options() == {}
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://localhost:9000")
    assert objects.client_options() == {"client_options": {"allow_http": True}}
