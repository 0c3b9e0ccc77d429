"""A place is named by a folder or a URL, and what is none of them is refused in a sentence."""

from __future__ import annotations

from pathlib import Path

import pytest

from integ_gym.cli import main
from integ_gym.support.files.writing import told_path
from integ_gym.support.storing.places import (
    as_storage,
    is_remote,
    named_place,
    stored,
)
from integ_gym.support.storing.storage import FolderStorage


@pytest.mark.parametrize("url", ["s3://bucket/run", "gs://bucket/a/run/", "az://box/run"])
def test_places_in_object_stores(url):
    assert is_remote(url)
    assert named_place(url) == url.rstrip("/")
    assert told_path(url) == url


@pytest.mark.parametrize(
    ("named", "path"),
    [
        ("runs/panel", "runs/panel"),
        ("file:///shared/a%20run", "/shared/a run"),
        (Path("/shared/run"), "/shared/run"),
        ("odd:name", "odd:name"),
    ],
)
def test_folders(named, path):
    assert not is_remote(named)
    assert named_place(named) == Path(path)


@pytest.mark.parametrize(
    "url", ["s3://bucket", "s3:/bucket/run", "ftp://host/run", "file://host/x"]
)
def test_other_urls_are_refused(url):
    with pytest.raises(ValueError, match="is no place for a run; give a folder") as refused:
        named_place(url)
    assert url in str(refused.value)


def test_a_folder_is_worked_on_where_it_is(tmp_path):
    with stored(tmp_path) as storage:
        assert (storage.path, storage.remote, str(storage)) == (tmp_path, False, str(tmp_path))
    assert isinstance(as_storage(tmp_path), FolderStorage)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["diagnose", "--out", "s3://bucket/run"], "expected a path of this machine"),
        (["evidence", "seal", "s3://bucket/run"], "once it is copied here"),
        (["panel", "--power", "--out", "s3://bucket/run"], "give it a copy of the run"),
        (["panel", "--sign", "key", "--out", "s3://bucket/run"], "--sign signs a run on this"),
        (["panel", "--out", "s3://bucket/run", "--policies", "s3://b/r"], "a path of this machine"),
    ],
)
def test_what_cannot_be_done_there_is_refused(words, told, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    try:
        code = main(words)
    except SystemExit as ended:
        code = int(ended.code)
    assert code == 2
    assert told in " ".join(capsys.readouterr().err.split())
    assert not list(tmp_path.iterdir())
