"""A run's directory that is damaged is refused by name, and holds no remains."""

from __future__ import annotations

import json
import time

import pytest

from integ_gym.eval.panel.running.run_directory import (
    MANIFEST,
    RunDirectory,
    RunDirectoryError,
    key_of,
)


@pytest.fixture
def directory(tmp_path):
    made = RunDirectory(tmp_path / "run", {"name": "a"})
    with made.opened():
        made.finish("train-a", "key", time.time(), policy="hash")
    return made


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        ("{}", "it lacks 'key'"),
        ('{"key": "key", "start": 1, "end": 2, "policy": "hash"}', "it lacks 'seconds'"),
        ('{"key": "key", "start": 1, "end": 2, "seconds": 1}', "it lacks 'policy'"),
        ('{"key": "key", "start": 1, "end": 2, "seconds": 1e400, "policy": ""}', "not finite"),
        ("[]", "a list where an object was expected"),
        ("[" * 100_000, "deep"),
        ("", "Expecting value"),
    ],
)
def test_a_damaged_marker_is_named_with_the_remedy(directory, content, fault):
    file = directory.path / "units" / "train-a.json"
    file.write_text(content)
    with pytest.raises(RunDirectoryError, match=r"remove it to do the unit again$") as refused:
        directory.seconds(["train-a"])
    assert str(file) in str(refused.value)
    assert fault in str(refused.value)


@pytest.mark.parametrize(
    "content", ["[]", "{}", '{"specification": []}', "[" * 100_000, "1" * 5000]
)
def test_a_damaged_manifest_is_named_with_the_remedy(directory, content):
    file = directory.path / MANIFEST
    file.write_text(content)
    with pytest.raises(RunDirectoryError, match="restore it from a copy") as refused:
        directory.opened().__enter__()
    assert str(file) in str(refused.value)


def test_what_an_interrupted_run_left_is_gone_when_it_goes_on(directory):
    folder = directory.policies / "a"
    folder.mkdir()
    places = (directory.path, directory.evidence, directory.path / "units", folder)
    for place in places:
        (place / ".left.0123.tmp").write_text("half")
    with directory.opened():
        assert not [file for place in places for file in place.glob(".*.tmp")]
    assert not (directory.path / ".lock").exists()


def test_keys_and_other_facts_are_kept(directory):
    marker = json.loads((directory.path / "units" / "train-a.json").read_text())
    assert directory.marker("train-a") == marker
    assert directory.finished("train-a", "key", records=False) == marker
    assert key_of({}, a=1) != key_of({}, a=2)
