"""Places of runs: how they are named, and how a copy follows an object store, over HTTP."""

import json
import os
import pickle
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from integ_gym.cli import main
from integ_gym.support import storage
from integ_gym.support.files import display_path
from integ_gym.support.storage import (
    LOCK,
    BusyError,
    FileLock,
    Storage,
    StorageError,
    is_remote,
    open_storage,
    resolve_place,
)


def test_places_are_folders_or_in_object_stores(tmp_path):
    for url in ("s3://bucket/run", "gs://bucket/a/run/", "az://box/run"):
        assert is_remote(url)
        assert resolve_place(url) == url.rstrip("/")
        assert display_path(url) == url
    for named, path in (
        ("runs/panel", "runs/panel"),
        ("file:///shared/a%20run", "/shared/a run"),
        (Path("/shared/run"), "/shared/run"),
        ("odd:name", "odd:name"),
    ):
        assert not is_remote(named)
        assert resolve_place(named) == Path(path)
    for url in ("s3://bucket", "s3:/bucket/run", "ftp://host/run", "file://host/x"):
        with pytest.raises(ValueError, match=f"{url}.* is no place for a run; give a folder"):
            resolve_place(url)
    with open_storage(tmp_path) as place:
        assert (place.path, place.remote, str(place)) == (tmp_path, False, str(tmp_path))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["diagnose", "--out", "s3://bucket/run"], "expected a path of this machine"),
        (["evidence", "seal", "s3://bucket/run"], "once it is copied here"),
        (["panel", "--power", "--out", "s3://bucket/run"], "a copy of the run, or omit it"),
        (["panel", "--sign", "key", "--out", "s3://bucket/run"], "--sign signs a run on this"),
        (["panel", "--out", "s3://bucket/run", "--policies", "s3://b/r"], "a path of this machine"),
    ],
)
def test_what_cannot_be_done_there_is_refused(words, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    try:
        code = main(words)
    except SystemExit as ended:
        code = int(ended.code)
    assert code == 2
    assert message in " ".join(capsys.readouterr().err.split())
    assert not list(tmp_path.iterdir())


def test_no_plain_endpoint_is_asked_unless_it_was_named(monkeypatch):
    for name in storage.ENDPOINTS:
        monkeypatch.delenv(name, raising=False)
    assert storage._client_options() == {}
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://localhost:9000")
    assert storage._client_options() == {"client_options": {"allow_http": True}}


HOLDER = """
import sys, time
from pathlib import Path
from integ_gym.support.storage import FileLock
assert FileLock(Path(sys.argv[1])).acquire()
print("held", flush=True)
time.sleep(600.0)
"""


def test_a_file_has_one_holder_at_a_time_and_a_killed_one_holds_nothing(tmp_path):
    one, other = FileLock(tmp_path / "lock"), FileLock(tmp_path / "lock")
    assert one.acquire()
    assert not other.acquire()
    other.release()
    assert not other.acquire()
    one.release()
    assert list(tmp_path.iterdir()) == []
    command = [sys.executable, "-c", HOLDER, str(tmp_path / "lock")]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as holder:
        assert holder.stdout.readline() == b"held\n"
        assert not other.acquire()
        holder.kill()
    assert other.acquire()
    other.release()


@pytest.fixture
def place(bucket):
    with open_storage(bucket) as opened:
        yield opened


def _write(place, name, text):
    path = place.path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


@pytest.mark.slow
def test_a_copy_is_sent_and_fetched(place, bucket):
    files = {"run.json": "1", "units/a.json": "2", ".work/division.json": "3", "seal.json": "4"}
    for name, text in files.items():
        _write(place, name, text)
    for name in (".lock", "units/.a.json.0.tmp", ".seal.json"):
        _write(place, name, "hidden")
    place.send()
    with open_storage(bucket) as other:
        assert sorted(other.names()) == sorted(files)
        other.fetch("run.json")
        assert not (other.path / "seal.json").exists()
        other.fetch()
        assert {n: (other.path / n).read_text(encoding="utf-8") for n in files} == files
        (other.path / "units/a.json").unlink()
        _write(other, "run.json", "more")
        other.send()
    assert sorted(place.names()) == [".work/division.json", "run.json", "seal.json"]
    place.fetch("run.json")
    assert (place.path / "run.json").read_text(encoding="utf-8") == "more"


@pytest.mark.slow
def test_markers_and_the_seal_are_sent_last_and_removed_first(place, monkeypatch):
    sent, removed = [], []
    monkeypatch.setattr(place._files, "put", lambda files, names: sent.append(names))
    for name in ("evidence/a.parquet", "units/a.json", "policies/a/policy.json", "seal.json"):
        _write(place, name, "1")
    place.send()
    folders = [{name.split("/")[2] for name in part} for part in sent]
    assert folders == [{"evidence", "policies"}, {"units"}, {"seal.json"}]
    monkeypatch.setattr(place, "_remove", removed.append)
    for file in [*place.path.rglob("*.*")]:
        file.unlink()
    place.send()
    assert removed[:2] == ["seal.json", "units/a.json"]


@pytest.mark.slow
def test_another_process_works_in_the_folder_alone(place):
    there = pickle.loads(pickle.dumps(place))
    assert type(there) is Storage
    assert there.path == place.path


@pytest.mark.slow
def test_one_driver_at_a_time(place, bucket):
    """The lock of a killed process of this machine is taken over; any other must be removed."""
    with open_storage(bucket) as other:
        busy = pytest.raises(
            BusyError, match=rf"process {os.getpid()} on .* is running the panel in"
        )
        with place.locked(), busy:
            other.locked().__enter__()
        with other.locked():
            pass
        gone = subprocess.Popen([sys.executable, "-c", ""])
        gone.wait()
        holder = {"host": socket.gethostname(), "process": gone.pid, "since": "2026"}
        _put_lock(place, holder)
        with other.locked():
            pass
        _put_lock(place, {**holder, "host": "elsewhere"})
        with pytest.raises(
            BusyError, match=rf"if it was killed, remove {bucket}/{LOCK} and run this"
        ):
            other.locked().__enter__()


def _put_lock(place, holder):
    place._obstore.put(place._store, LOCK, json.dumps(holder).encode())


@pytest.mark.slow
def test_a_bucket_that_is_not_there_is_told_in_a_sentence(bucket):
    with (
        open_storage(bucket.replace("bucket", "another-bucket", 1)) as absent,
        pytest.raises(StorageError, match="see that the bucket is there"),
    ):
        absent.names()
